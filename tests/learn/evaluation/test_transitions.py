"""Transitions are those of the dataset, and policies are asked in the same rows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.learn.evaluation.transitions import Transitions, actions_of
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.setup import Sizes
from swarmdata.specs.origins import RecordedAgent, RecordedSpec
from swarmdata.specs.spaces import BoxSpace
from swarmdata.types import Float
from tests.learn.chain import N_AGENTS, Constant, chain, episode
from tests.support.memory_dataset import MemoryDataset


class Mirror:
    """Does what it sees."""

    def actions(self, observations: Float) -> Float:
        return observations[..., :1].astype(np.float32)


def read(dataset: MemoryDataset, discount: float = 0.5) -> Transitions:
    return Transitions.read(dataset, Statistics.measure(dataset, discount), discount)


@given(st.lists(st.tuples(st.integers(1, 6), st.booleans()), min_size=1, max_size=5))
def test_rows_are_the_datasets_transitions(episodes: list[tuple[int, bool]]) -> None:
    rng = np.random.default_rng(0)
    dataset = MemoryDataset([episode(rng, n, k % 2, ends=e) for k, (n, e) in enumerate(episodes)])
    data, rows = read(dataset), dataset.transitions
    statistics = Statistics.measure(dataset, 0.5)
    std = statistics.state_std if statistics.state_std > 1e-3 else 1.0
    for states, where in ((rows["states"], data.rows), (rows["next_states"], data.rows + 1)):
        expected = (states[:, 0] - statistics.state_mean) / std
        np.testing.assert_allclose(data.x[where, 0], expected, atol=1e-5)
    np.testing.assert_array_equal(data.actions, rows["actions"])
    np.testing.assert_allclose(data.rewards, rows["rewards"].mean(1), atol=1e-6)
    np.testing.assert_array_equal(data.terminations, rows["terminations"])
    lengths = [n for n, _ in episodes]
    assert len(data) == sum(lengths)
    assert data.x.shape == (sum(lengths) + len(lengths), 1 + N_AGENTS)
    assert data.sizes == Sizes(N_AGENTS, 1, 1, 1)
    returns = [
        sum(0.5**t * reward for t, reward in enumerate(each.rewards.mean(1))) for each in dataset
    ]
    np.testing.assert_allclose(data.initial_returns, returns, atol=1e-5)


def test_policies_are_asked_in_every_state() -> None:
    dataset = chain(4, ends=False)
    data = read(dataset)
    answers = actions_of([Mirror(), Constant(0.25)], dataset)
    assert answers.shape == (2, len(data.x), N_AGENTS, 1)
    assert answers.dtype == np.float32
    states = dataset.transitions["states"][:, 0]
    np.testing.assert_array_equal(answers[0, data.rows.numpy(), 0, 0], states)
    np.testing.assert_array_equal(answers[0, data.rows.numpy() + 1, 1, 0], 1 - states)
    np.testing.assert_array_equal(answers[1], 0.25)


def test_who_has_left_does_nothing() -> None:
    whole = chain(1, ends=True).episodes[0]
    alive = np.array([[True, True], [True, False], [True, False]])
    uncut = np.zeros((2, 2), np.bool_)
    dataset = MemoryDataset([replace(whole, alive=alive, agent_truncations=uncut)])
    np.testing.assert_array_equal(actions_of([Constant(1.0)], dataset)[0, :, :, 0], alive)
    actions = read(dataset).actions[..., 0]
    np.testing.assert_array_equal(actions, whole.actions[..., 0] * alive[:-1])


def recorded(high: float) -> MemoryDataset:
    agents = tuple(
        RecordedAgent(
            name=name,
            observation=BoxSpace(shape=(1,), low=0.0, high=1.0, dtype="float32"),
            action=BoxSpace(shape=(1,), low=-high, high=high, dtype="float32"),
        )
        for name in ("a", "b")
    )
    spec = RecordedSpec(task="x_v0", agents=agents, state_size=1, state_from="environment")
    return MemoryDataset(chain(3, ends=True).episodes, spec=spec)  # type: ignore[arg-type]


def test_actions_of_recorded_environments_are_scaled() -> None:
    plain = chain(3, ends=True).transitions["actions"]
    np.testing.assert_allclose(read(recorded(4.0)).actions, plain / 4, atol=1e-6)
    with pytest.raises(SchemaError, match="the bounds of its space"):
        read(recorded(0.5))


def test_what_cannot_be_asked_or_read_is_an_error() -> None:
    with pytest.raises(SchemaError, match=r"object has no `actions\(observations\)`"):
        actions_of([Constant(0.0), object()], chain(1, ends=True))
    with pytest.raises(SchemaError, match="no episodes of memory-v0"):
        Transitions.read(MemoryDataset([]), Statistics.measure(chain(1, ends=True), 0.5), 0.5)
