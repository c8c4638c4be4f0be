"""Checkpoints: what is saved comes back, and damage is an error."""

import re
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from swarmdata.errors import CheckpointError
from swarmdata.learn.training.checkpoint import load_checkpoint, part, save_checkpoint

TENSORS = {
    "a.x": torch.randn(3, 2),
    "a.y": torch.tensor(7),
    "b": torch.arange(5, dtype=torch.uint8),
    "c": torch.randn(4, 3).T,
    "empty": torch.zeros(0, 2),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "run.safetensors"
    save_checkpoint(file, TENSORS, {"update": 3, "nested": {"list": [1, None]}})
    return file


def test_tensors_and_metadata_come_back_exactly(path: Path) -> None:
    tensors, metadata = load_checkpoint(path)
    assert tensors.keys() == TENSORS.keys()
    for name, tensor in TENSORS.items():
        torch.testing.assert_close(tensors[name], tensor, rtol=0, atol=0)
    assert metadata == {"update": 3, "nested": {"list": [1, None]}}
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_the_digest_is_that_of_the_content(tmp_path: Path) -> None:
    digests = {save_checkpoint(tmp_path / n, TENSORS, {"u": 1}) for n in ("a", "b")}
    digests.add(save_checkpoint(tmp_path / "c", {**TENSORS, "a.y": torch.tensor(8)}, {"u": 1}))
    digests.add(save_checkpoint(tmp_path / "d", TENSORS, {"u": 2}))
    assert len(digests) == 3


def test_every_flipped_byte_is_an_error(path: Path) -> None:
    good = path.read_bytes()
    for position in range(0, len(good), 7):
        path.write_bytes(good[:position] + bytes([good[position] ^ 1]) + good[position + 1 :])
        with pytest.raises(CheckpointError):
            load_checkpoint(path)


@pytest.mark.parametrize("size", [0, 5, 100, -1])
def test_a_cut_file_is_an_error(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(CheckpointError, match=re.escape(str(path))):
        load_checkpoint(path)


def test_an_absent_file_and_another_programs_file_are_errors(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint at"):
        load_checkpoint(tmp_path / "none")
    save_file(TENSORS | {"c": torch.zeros(1)}, tmp_path / "other")
    with pytest.raises(CheckpointError, match="written by another program"):
        load_checkpoint(tmp_path / "other")


def test_part_selects_by_prefix() -> None:
    assert part(TENSORS, "a").keys() == {"x", "y"}
