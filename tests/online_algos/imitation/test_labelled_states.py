"""Labelled states are found again after a kill, and only the same ones."""

from pathlib import Path

import pytest
import torch

from swarmdata.errors import CheckpointError
from swarmdata.online_algos.imitation.labelled_states import StoredStates

N_SAMPLES, WIDTHS = 5, (3, 2)


def opened(folder: Path, n_rounds: int = 4) -> StoredStates:
    return StoredStates(folder, 2, n_rounds, N_SAMPLES, WIDTHS)


def some_round(number: int) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(number)
    return [torch.randn(2, N_SAMPLES, width, generator=generator) for width in WIDTHS]


def test_rounds_are_found_as_a_checkpoint_knows_them(tmp_path: Path) -> None:
    states = opened(tmp_path)
    for number in range(2):
        states.append(some_round(number))
    saved = states.state_dict()
    states.append(some_round(2))  # after the checkpoint
    again = opened(tmp_path)
    assert len(again) == 0
    again.load_state_dict(saved)
    assert len(again) == 2 * N_SAMPLES
    again.append(some_round(3))  # over the round that the killed process wrote
    for found, *rounds in zip(
        again.arrays, some_round(0), some_round(1), some_round(3), strict=True
    ):
        torch.testing.assert_close(found[:, : 3 * N_SAMPLES], torch.cat(rounds, 1), rtol=0, atol=0)


def test_other_rounds_are_refused(tmp_path: Path) -> None:
    states = opened(tmp_path)
    states.append(some_round(0))
    saved = states.state_dict()
    states.arrays[1][0, 0, 0] += 1
    with pytest.raises(CheckpointError, match="do not hold round 0"):
        opened(tmp_path).load_state_dict(saved)
    with pytest.raises(CheckpointError, match="belongs to another run"):
        opened(tmp_path, n_rounds=5)
