import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.sampling import Sampler
from swarmdata.errors import SchemaError
from swarmdata.specs.action_scaling import ActionScale
from swarmdata.testing.synthetic import make_dataset
from swarmdata.types import Batch, Episode

LENGTHS = [[3, 1, 7, 4, 2, 9, 1, 6, 1, 1, 12], [5, 5, 1, 8, 1, 1, 3, 2, 9, 9, 9]]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path: Path = tmp_path_factory.mktemp("sampling") / "ds"
    make_dataset(path, LENGTHS, n_steps=60)
    return Dataset.open(path)


def assert_equal_batches(first: Batch, second: Batch) -> None:
    for name in Batch.__dataclass_fields__:
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def steps_of(episode: Episode) -> dict[str, NDArray[Any]]:
    """What a batch has of each step; nobody acts after the end."""
    names = ("actions", "log_probs", "rewards", "terminations", "truncations")
    return {name: getattr(episode, name) for name in names} | {
        "observations": episode.observations[:-1],
        "next_observations": episode.observations[1:],
        "states": episode.states[:-1],
        "next_states": episode.states[1:],
        "next_actions": np.concatenate([episode.actions[1:], 0 * episode.actions[:1]]),
    }


def view_of(dataset: Dataset, seed: int) -> Dataset:
    """A view of some episodes, at least one."""
    rng = np.random.default_rng(seed)
    keep = rng.random(len(dataset)) < 0.5
    keep[rng.integers(len(dataset))] = True
    return dataclasses.replace(dataset, selection=np.flatnonzero(keep))


@settings(deadline=None)
@given(seed=st.integers(0, 2**64 - 1), batch_size=st.integers(1, 40))
def test_transitions_never_cross(dataset: Dataset, seed: int, batch_size: int) -> None:
    view = view_of(dataset, seed)
    batch = next(view.sampler(batch_size, seed=seed))
    by_seed = {episode.seed: episode for episode in view}
    for b in range(batch_size):
        episode = by_seed[int(batch.observations[b, 0, 0])]
        t = int(batch.observations[b, 0, 1])
        for name, values in steps_of(episode).items():
            assert np.array_equal(getattr(batch, name)[b], values[t]), name
        assert view[int(batch.episodes[b])].seed == episode.seed
    assert batch.mask.all()


@settings(deadline=None)
@given(seed=st.integers(0, 2**64 - 1), horizon=st.integers(1, 14))
def test_windows_never_cross(dataset: Dataset, seed: int, horizon: int) -> None:
    view = view_of(dataset, seed)
    sampler = view.sampler(8, horizon=horizon, seed=seed)
    batch = next(sampler)
    by_seed = {episode.seed: episode for episode in view}
    positions = {episode.seed: position for position, episode in enumerate(view)}
    assert batch.observations.shape[:2] == (8, horizon)
    for b in range(8):
        episode = by_seed[int(batch.observations[b, 0, 0, 0])]
        t = int(batch.observations[b, 0, 0, 1])
        n = min(horizon, len(episode) - t)
        expected = steps_of(episode) | {
            "mask": np.ones(len(episode), dtype=bool),
            "episodes": np.full(len(episode), positions[episode.seed]),
        }
        for name, values in expected.items():
            got = getattr(batch, name)[b]
            assert np.array_equal(got[:n], values[t : t + n]), name
            assert not got[n:].any(), name


@settings(deadline=None)
@given(seed=st.integers(0, 2**64 - 1), horizon=st.integers(1, 14), burn_in=st.integers(0, 14))
def test_segments_cut_episodes_from_their_start(
    dataset: Dataset, seed: int, horizon: int, burn_in: int
) -> None:
    """A segment is that of the drawn step; before it are the steps before, or padding."""
    view = view_of(dataset, seed)
    sampler = view.sampler(8, horizon=horizon, burn_in=burn_in, seed=seed)
    index = sampler.draw()
    batch = sampler.gather(index)
    drawn = view.sampler(8, seed=seed).gather(index)
    by_seed = {episode.seed: episode for episode in view}
    assert batch.mask.shape == (8, burn_in + horizon)
    for b in range(8):
        episode = by_seed[int(drawn.observations[b, 0, 0])]
        first = int(drawn.observations[b, 0, 1]) // horizon * horizon
        steps = np.arange(first - burn_in, first + horizon)
        inside = (steps >= 0) & (steps < len(episode))
        np.testing.assert_array_equal(batch.mask[b], inside)
        for name in ("observations", "states", "actions", "rewards", "terminations"):
            values = getattr(batch, name)[b]
            np.testing.assert_array_equal(values[inside], getattr(episode, name)[steps[inside]])
            assert not values[~inside].any()
        np.testing.assert_array_equal(
            batch.next_observations[b][inside], episode.observations[steps[inside] + 1]
        )


@pytest.mark.parametrize("horizon", [None, 4])
def test_every_valid_start_is_drawn_equally_often(dataset: Dataset, horizon: int | None) -> None:
    view = dataset.split("train")
    sampler = view.sampler(1000, horizon=horizon, seed=3)
    drawn = np.concatenate([sampler.draw() for _ in range(40)])
    rows, counts = np.unique(drawn, return_counts=True)
    assert rows.tolist() == sampler.rows.valid.tolist()
    assert len(rows) == view.n_steps
    # chi-square with n - 1 degrees of freedom: mean n - 1, standard deviation sqrt(2 (n - 1))
    expected = len(drawn) / len(rows)
    statistic = np.sum((counts - expected) ** 2 / expected)
    assert statistic < len(rows) - 1 + 5 * np.sqrt(2 * (len(rows) - 1))


@settings(deadline=None, max_examples=30)
@given(
    before=st.integers(0, 30), batch_size=st.sampled_from([1, 3, 64, 5000, 20000]), data=st.data()
)
def test_resume_continues_the_stream(
    dataset: Dataset, before: int, batch_size: int, data: st.DataObject
) -> None:
    seed = data.draw(st.integers(0, 2**64 - 1))
    whole = dataset.sampler(batch_size, seed=seed)
    for _ in range(before):
        whole.draw()
    state = json.loads(json.dumps(whole.state_dict()))
    resumed = dataset.sampler(batch_size, seed=seed)
    for _ in range(data.draw(st.integers(0, 5))):
        resumed.draw()
    resumed.load_state_dict(state)
    for _ in range(3):
        assert np.array_equal(whole.draw(), resumed.draw())
    assert whole.state_dict() == resumed.state_dict()


def test_batches_of_a_seed_are_one_stream(dataset: Dataset) -> None:
    small, large = dataset.sampler(10, seed=5), dataset.sampler(3 * 10**4, seed=5)
    stream = large.draw()
    for k in range(2000):
        assert np.array_equal(small.draw(), stream[10 * k : 10 * k + 10])


def test_seeds_give_different_streams(dataset: Dataset) -> None:
    draws = [dataset.sampler(64, seed=seed).draw() for seed in range(5)]
    assert len({tuple(draw) for draw in draws}) == 5


def test_the_stream_is_pinned(dataset: Dataset) -> None:
    """A recorded run can be repeated with any later version."""
    assert dataset.n_steps == 61
    assert dataset.sampler(6, seed=7).draw().tolist() == [44, 39, 33, 36, 21, 11]


def test_other_settings_are_refused_on_resume(dataset: Dataset) -> None:
    state = dataset.sampler(8, seed=1).state_dict()
    for other in (
        dataset.sampler(9, seed=1),
        dataset.sampler(8, seed=2),
        dataset.sampler(8, horizon=2, seed=1),
        dataset.sampler(8, horizon=2, burn_in=0, seed=1),
        dataset.split("train").sampler(8, seed=1),
    ):
        with pytest.raises(SchemaError, match="resume with"):
            other.load_state_dict(state)
    with pytest.raises(SchemaError, match="resume with"):
        dataset.sampler(8, seed=1).load_state_dict({**state, "n_drawn": -1})


@pytest.mark.parametrize("horizon", [None, 5])
def test_stacked_indices_give_stacked_fields(dataset: Dataset, horizon: int | None) -> None:
    samplers = [dataset.sampler(6, horizon=horizon, seed=seed) for seed in range(3)]
    index = np.stack([sampler.draw() for sampler in samplers])
    stacked = samplers[0].gather(index)
    assert stacked.mask.shape == ((3, 6) if horizon is None else (3, 6, horizon))
    for k in range(3):
        alone = samplers[0].gather(index[k])
        columns = {f.name: getattr(stacked, f.name) for f in dataclasses.fields(stacked)}
        one = Batch(**{n: None if v is None else v[k] for n, v in columns.items()})
        assert_equal_batches(alone, one)


@pytest.mark.parametrize("horizon", [None, 5])
def test_only_the_wanted_fields_are_read(dataset: Dataset, horizon: int | None) -> None:
    """There are no other arrays that it could read."""
    wanted = {"observations", "next_actions", "episodes"}
    arrays = {name: dataset.stored.arrays[name] for name in ("observations", "actions")}
    index = np.arange(16)
    sampler = Sampler(arrays, dataset.stored.table, dataset.selection, horizon=horizon)
    some, whole = sampler.gather(index, wanted), dataset.sampler(horizon=horizon).gather(index)
    for name in Batch.__dataclass_fields__:
        expected = getattr(whole, name) if name in {*wanted, "mask"} else None
        np.testing.assert_array_equal(getattr(some, name), expected, strict=True)


def test_batches_are_the_callers_to_keep(dataset: Dataset) -> None:
    sampler = dataset.sampler(16, horizon=4)
    index = sampler.draw()
    first = sampler.gather(index)
    first.observations[...] = -1
    assert not (sampler.gather(index).observations == -1).all()
    kept = index.copy()
    index[...] = 0
    again = dataset.sampler(16, horizon=4)
    assert np.array_equal(again.draw(), kept)


def test_iterating_is_draw_then_gather(dataset: Dataset) -> None:
    first, second = dataset.sampler(5, seed=2), dataset.sampler(5, seed=2)
    for batch, _ in zip(first, range(3), strict=False):
        assert_equal_batches(batch, second.gather(second.draw()))
    assert "n_drawn=3" in repr(second)


@pytest.mark.parametrize("index", [[-1], [10**6]])
@pytest.mark.parametrize("horizon", [None, 3])
def test_indices_outside_are_refused(
    dataset: Dataset, index: list[int], horizon: int | None
) -> None:
    with pytest.raises(IndexError):
        dataset.sampler(2, horizon=horizon).gather(np.array(index))


def test_impossible_samplers_are_refused(dataset: Dataset) -> None:
    with pytest.raises(SchemaError, match="no episodes"):
        dataset.filter(min_return=1e9).sampler()
    with pytest.raises(SchemaError, match="batch_size=0"):
        dataset.sampler(0)
    with pytest.raises(SchemaError, match="horizon=0"):
        dataset.sampler(horizon=0)
    with pytest.raises(SchemaError, match="burn_in=2 and horizon=None"):
        dataset.sampler(burn_in=2)
    with pytest.raises(SchemaError, match="burn_in=-1"):
        dataset.sampler(horizon=3, burn_in=-1)
    with pytest.raises(SchemaError, match="2\\*\\*64"):
        dataset.sampler(seed=-1)


@pytest.mark.parametrize("horizon", [None, 5])
def test_torch_batches_share_memory(dataset: Dataset, horizon: int | None) -> None:
    pytest.importorskip("torch", reason="tensors need the torch extra")
    batch = next(dataset.sampler(4, horizon=horizon))
    tensors = batch.to_torch()
    tensors.rewards[0, ...] = 42
    assert (batch.rewards[0] == 42).all()
    assert np.array_equal(tensors.log_probs.numpy(), batch.log_probs)


@pytest.mark.parametrize("horizon", [None, 5])
def test_without_recorded_log_probs_a_batch_has_none(dataset: Dataset, horizon: int | None) -> None:
    arrays = dict(dataset.stored.arrays)
    arrays["log_probs"] = arrays["log_probs"][:, :0]
    sampler = Sampler(arrays, dataset.stored.table, dataset.selection, horizon=horizon)
    batch = sampler.gather(sampler.rows.valid)
    assert batch.log_probs is None
    pytest.importorskip("torch", reason="tensors need the torch extra")
    assert batch.to_torch().log_probs is None


@pytest.mark.parametrize("horizon", [None, 5])
def test_next_actions_are_scaled_as_actions_are(dataset: Dataset, horizon: int | None) -> None:
    """The middle is not 0; what an agent that is gone did is out of bounds, and never looked at."""
    table, arrays = dataset.stored.table, dict(dataset.stored.arrays)
    alive = np.random.default_rng(0).random((len(arrays["states"]), 2)) < 0.7
    here = np.arange(dataset.n_steps) + np.repeat(np.arange(len(table)), table.lengths)
    acted = alive[here][..., None]
    arrays["actions"] = np.where(acted, arrays["actions"] + 3, 99).astype(np.float32)
    arrays["alive"] = alive
    arrays["agent_terminations"] = leaves = acted[..., 0] & ~alive[here + 1]
    scale = ActionScale(middle=np.full((2, 2), 3.0), half=np.full((2, 2), 2.0))
    sampler = Sampler(arrays, table, dataset.selection, horizon=horizon, scale=scale)
    index = sampler.rows.valid
    batch = sampler.gather(index)
    acts_next = alive[here + 1]
    for recorded, name in (
        (alive[here], "alive"), (leaves, "agent_terminations"), (acts_next, "next_alive"),
    ):  # fmt: skip
        found = getattr(batch, name)
        np.testing.assert_array_equal(found if horizon is None else found[:, 0], recorded)
        assert not found[~batch.mask].any()
    plain = np.where(acted, (arrays["actions"] - 3) / 2, 0)
    following = np.concatenate([plain[1:], plain[:1]])
    following[table.starts + table.lengths - 1] = 0
    ours = batch.next_actions if horizon is None else batch.next_actions[:, 0]
    np.testing.assert_allclose(ours, following, atol=1e-6)
    if horizon is not None:
        both = batch.mask[:, 1:]
        np.testing.assert_array_equal(batch.next_actions[:, :-1][both], batch.actions[:, 1:][both])
        assert not batch.next_actions[~batch.mask].any()
