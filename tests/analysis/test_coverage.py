"""Coverage of recorded data: what is sampled, and what the figures tell apart."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.analysis.coverage import (
    ENTROPY_RESOLUTION,
    MIN_STEPS,
    N_PAIR_ROWS,
    coverage,
    dependence,
    sample_steps,
    spread,
)
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.store import StoredDataset, open_store
from tests.support.episode_table import episode_table

Record = Callable[..., Path]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, record: Record) -> StoredDataset:
    folder = tmp_path_factory.mktemp("coverage") / "data"
    return open_store(record(folder, TaskSpec(horizon=120), ("random",)))


def test_random_covers_more_than_idle(
    stored: StoredDataset, tmp_path: Path, record: Record
) -> None:
    at_rest = open_store(record(tmp_path / "data", TaskSpec(horizon=120), ("idle",)))
    random, idle = coverage(stored), coverage(at_rest)
    assert random.places.visited > idle.places.visited > 0.0
    assert random.places.entropy > idle.places.entropy
    for name in ("states", "actions"):
        a, b = getattr(random, name), getattr(idle, name)
        assert a.robot > b.robot
        assert a.team > b.team
    assert random.actions is not None
    assert random.actions.robot == pytest.approx(2 * np.log(2), abs=0.25)  # uniform in a square
    assert idle.actions is not None
    assert idle.actions.robot == pytest.approx(2 * np.log(ENTROPY_RESOLUTION), abs=0.25)  # at rest
    assert random.distinct == 1.0 > idle.distinct, "robots at rest repeat"
    assert (random.bounds, idle.bounds) == (0.0, 0.0)
    assert random.passings.keys() == {0}


def test_independent_commands_have_no_dependence(stored: StoredDataset) -> None:
    found = coverage(stored).dependence
    assert found is not None
    assert found.n_pairs == 6
    assert abs(found.information) < 0.1
    assert found.correlation < 0.1


def test_copied_commands_are_dependent() -> None:
    one = np.random.default_rng(0).uniform(-1, 1, (N_PAIR_ROWS, 1, 2))
    found = dependence(np.concatenate([one, one], axis=1))
    assert found is not None
    assert found.information > 3.0
    assert found.correlation == pytest.approx(1.0)
    assert dependence(one) is None, "a single robot"
    assert dependence(np.repeat(one[: MIN_STEPS - 1], 2, axis=1)) is None


def test_same_data_same_figures(stored: StoredDataset) -> None:
    first, second = coverage(stored), coverage(stored)
    assert first.states == second.states
    assert first.dependence == second.dependence
    assert (first.places.visits == second.places.visits).all()
    assert first.places.visits.sum() == first.n_states * stored.recipe.spec.n_agents


def test_very_few_steps_have_places_but_no_entropies(
    tmp_path: Path, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = TaskSpec(horizon=3, team=(Role(count=2),))
    monkeypatch.setattr("swarmdata.analysis.coverage.MIN_STEPS", 25)
    found = coverage(open_store(record(tmp_path / "data", spec, ("random",))))
    assert (found.n_steps, found.n_states) == (24, 32)
    assert (found.states, found.actions, found.dependence) == (None, None, None)
    assert found.places.visited > 0.0


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=12),
    st.integers(1, 80),
    st.integers(0, 2**32 - 1),
)
def test_sampled_steps_are_distinct_and_of_the_selection(
    lengths: list[int], n_rows: int, seed: int
) -> None:
    starts = np.cumsum(lengths) - lengths
    table = episode_table(len(lengths), starts=starts, lengths=lengths)
    kept = np.random.default_rng(seed).random(len(lengths)) < 0.6
    kept[seed % len(lengths)] = True
    selection = np.flatnonzero(kept)
    steps, states = sample_steps(table, selection, n_rows)
    allowed = {
        int(table.starts[e]) + t: int(table.starts[e]) + e + t
        for e in selection.tolist()
        for t in range(lengths[e])
    }
    assert len(steps) == min(n_rows, len(allowed)) == len(set(steps.tolist()))
    assert [allowed[step] for step in steps.tolist()] == states.tolist()


@given(st.integers(1, 50), st.integers(1, 60))
def test_spread_keeps_order_and_reaches_far(n: int, most: int) -> None:
    items = spread(np.arange(n), most)
    assert len(items) == min(n, most)
    assert (np.diff(items) >= 1).all()
    assert items[0] == 0
    assert n - items[-1] <= -(-n // len(items))
