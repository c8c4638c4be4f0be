"""Small checkpoints: the same policies of every algorithm, and nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="a run is trained")

import torch

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import CheckpointError
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.compact import compact, is_same
from swarmdata.learn.training.run_files import CHECKPOINT
from swarmdata.learn.training.run_folder import COMPACT, load_run, read_run
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from tests.support.tiny import make_tiny


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = make_tiny(tmp_path_factory.mktemp("compact") / "coop_nav-tiny-v0")
    return Dataset.open(folder).split("train")


@pytest.mark.parametrize("name", sorted(OFFLINE_ALGORITHMS))
def test_policies_of_every_algorithm_survive(name: str, data: Dataset, tmp_path: Path) -> None:
    config = resolve("algorithm", OFFLINE_ALGORITHMS, name).Config(n_updates=2, batch_size=16)
    policies = train_seeds(name, data, tmp_path, seeds=(0, 1), config=config, progress=False)
    before = (tmp_path / CHECKPOINT).stat().st_size
    compact(tmp_path)
    assert is_same(load_run(tmp_path), policies)
    assert not is_same(*policies)  # of two seeds
    tensors, metadata = load_checkpoint(tmp_path / CHECKPOINT)
    assert metadata[COMPACT]
    assert (tmp_path / CHECKPOINT).stat().st_size < before / 2
    assert not any("adam" in key or "optimizer" in key for key in tensors)
    content = (tmp_path / CHECKPOINT).read_bytes()
    compact(tmp_path)
    assert (tmp_path / CHECKPOINT).read_bytes() == content
    again = train_seeds(name, data, tmp_path, seeds=(0, 1), config=config, progress=False)
    assert is_same(again, policies)


def test_a_run_that_is_not_finished_is_refused(data: Dataset, tmp_path: Path) -> None:
    config = resolve("algorithm", OFFLINE_ALGORITHMS, "bc").Config(n_updates=40, batch_size=16)

    def stop(updates: int) -> None:
        if (tmp_path / CHECKPOINT).exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_seeds(
            "bc", data, tmp_path, config=config, schedule=Schedule(1, 10), progress=False,
            report=stop,
        )  # fmt: skip
    with pytest.raises(CheckpointError, match="is at update 10 of 40; finish it"):
        compact(tmp_path)


def test_policies_that_are_not_the_same_are_told_apart(data: Dataset, tmp_path: Path) -> None:
    config = resolve("algorithm", OFFLINE_ALGORITHMS, "bc").Config(n_updates=1, batch_size=16)
    (policy,) = train_seeds("bc", data, tmp_path, seeds=(0,), config=config, progress=False)
    assert is_same([policy], (policy,))
    assert not is_same(policy, replace(policy, squash=False))  # type: ignore[type-var]
    assert not is_same(torch.zeros(2), torch.zeros(3))
    assert not is_same(torch.zeros(1), 0.0)
    assert not is_same([1], [1, 2])
    assert read_run(tmp_path).seeds == (0,)
