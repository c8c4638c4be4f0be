"""The replay: what comes out is what went in, the newest of it, after a kill as well."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import CheckpointError, SchemaError
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.training.replay_buffer import Replay, Shape
from swarmdata.types import Batch

SIZES = Sizes(n_agents=2, observation=3, action=2, state=4)


def shape(capacity: int = 5, margin: int = 3, n_seeds: int = 2, n_copies: int = 3) -> Shape:
    return Shape(SIZES, n_seeds, n_copies, capacity, margin)


def row(number: int, n_seeds: int = 2, n_copies: int = 3) -> Batch:
    """Every field tells the row, the seed and the copy, and which field it is."""
    k, e = np.meshgrid(np.arange(n_seeds), np.arange(n_copies), indexing="ij")
    code = (number * 100 + k * 10 + e).astype(np.float32)

    def field(offset: float, *features: int) -> np.ndarray:
        axes = (..., *(None for _ in features))
        return np.broadcast_to(code[axes] + np.float32(offset), (*code.shape, *features))

    return Batch(
        observations=field(0.0, 2, 3),
        states=field(0.125, 4),
        next_observations=field(0.25, 2, 3),
        next_states=field(0.375, 4),
        actions=field(0.5, 2, 2),
        rewards=field(0.625, 2),
        terminations=e == 1,
        truncations=e == 2,
        mask=np.ones_like(e, dtype=np.bool_),
    )


def filled(folder: Path, n_rows: int, **sizes: int) -> Replay:
    replay = Replay(shape(**sizes), folder)
    for number in range(n_rows):
        replay.append(row(number))
    return replay


@given(n_rows=st.integers(1, 30), seed=st.integers(0, 99))
def test_draws_are_whole_transitions_of_the_newest_rows_and_of_their_seed(
    tmp_path_factory: pytest.TempPathFactory, n_rows: int, seed: int
) -> None:
    replay = filled(tmp_path_factory.mktemp("ring"), n_rows)
    batch = replay.sample(generators([seed, seed + 1], "cpu"), 64)
    code = batch.observations[..., 0, 0]
    assert batch.next_actions is None  # online training keeps neither
    assert batch.log_probs is None
    numbers, seeds, copies = code // 100, code % 100 // 10, code % 10
    assert numbers.min() >= max(0, n_rows - 5)
    assert numbers.max() < n_rows
    assert (seeds == torch.arange(2)[:, None]).all()
    fields = (
        batch.observations, batch.states, batch.next_observations, batch.next_states,
        batch.actions, batch.rewards,
    )  # fmt: skip
    for offset, field in enumerate(fields):
        flat = field.reshape(2, 64, -1)
        assert (flat == (code + offset / 8)[..., None]).all()
    assert torch.equal(batch.terminations, copies == 1)
    assert torch.equal(batch.truncations, copies == 2)
    assert batch.observations.shape == (2, 64, 2, 3)
    assert batch.actions.shape == (2, 64, 2, 2)
    assert batch.mask.all()


def test_every_transition_is_drawn_about_as_often(tmp_path: Path) -> None:
    replay = filled(tmp_path, 7)
    batch = replay.sample(generators([0, 1], "cpu"), 15 * 400)
    for seed in range(2):
        codes, counts = batch.observations[seed, :, 0, 0].unique(return_counts=True)
        assert len(codes) == 15  # 5 rows of 3 copies
        assert (counts - 400).abs().max() < 100  # 5 standard deviations


@pytest.mark.parametrize("later", [0, 1, 3])
def test_a_killed_run_finds_the_rows_of_its_checkpoint(tmp_path: Path, later: int) -> None:
    replay = filled(tmp_path, 11)
    saved = replay.state_dict()
    expected = replay.sample(generators([0, 1], "cpu"), 50)
    for number in range(11, 11 + later):
        replay.append(row(number + 500))  # what came after the checkpoint is to be forgotten
    resumed = Replay(shape(), tmp_path)
    resumed.load_state_dict(saved)
    drawn = resumed.sample(generators([0, 1], "cpu"), 50)
    assert torch.equal(drawn.observations, expected.observations)
    assert len(resumed) == 5
    resumed.append(row(11))
    assert resumed.state_dict()["n_written"] == 12


def test_a_checkpoint_that_is_too_old_is_refused(tmp_path: Path) -> None:
    replay = filled(tmp_path, 11)
    saved = replay.state_dict()
    for number in range(11, 15):
        replay.append(row(number))
    with pytest.raises(CheckpointError, match=r"does not hold row 6 .* more than 3 rows"):
        Replay(shape(), tmp_path).load_state_dict(saved)


def test_a_damaged_or_empty_ring_is_refused(tmp_path: Path) -> None:
    saved = filled(tmp_path / "a", 2).state_dict()
    with pytest.raises(CheckpointError, match="does not hold row 0"):
        Replay(shape(), tmp_path / "b").load_state_dict(saved)


def test_a_ring_of_other_sizes_is_refused(tmp_path: Path) -> None:
    saved = filled(tmp_path, 2).state_dict()
    with pytest.raises(CheckpointError, match=r"expected .* it belongs to another run"):
        Replay(shape(capacity=6), tmp_path)
    with pytest.raises(CheckpointError, match="has 8 rows, expected 7"):
        Replay(shape(capacity=4), tmp_path / "other").load_state_dict(saved)


def test_mistakes_are_told(tmp_path: Path) -> None:
    replay = Replay(shape(), tmp_path)
    with pytest.raises(SchemaError, match="replay is empty"):
        replay.sample(generators([0, 1], "cpu"), 4)
    wrong = row(0)
    object.__setattr__(wrong, "rewards", wrong.rewards[..., :1])
    with pytest.raises(SchemaError, match="got a field of 1 numbers per copy, expected 2"):
        replay.append(wrong)
    with pytest.raises(SchemaError, match="at least one seed"):
        shape(capacity=0)
