"""Temporal-difference targets, returns-to-go and statistics, by hand."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.learn.networks.network_inputs import standardize, with_agent_id  # noqa: E402
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.learn.objectives.td_targets import (  # noqa: E402
    move_target,
    td_error,
    td_target,
    team_reward,
)
from swarmdata.learn.training.dataset_statistics import Statistics, returns_to_go  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Episode, no_messages  # noqa: E402


def episode(rewards: list[float], level: float) -> Episode:
    """2 agents that both get `rewards`; every observation and state is `level`."""
    steps = len(rewards)
    last = np.arange(steps) == steps - 1
    return Episode(
        observations=np.full((steps + 1, 2, 3), level, dtype=np.float32),
        states=np.full((steps + 1, 4), level, dtype=np.float32),
        actions=np.zeros((steps, 2, 2), dtype=np.float32),
        log_probs=np.zeros((steps, 2), dtype=np.float32),
        rewards=np.repeat(np.array(rewards, dtype=np.float32)[:, None], 2, 1),
        terminations=last,
        truncations=np.zeros(steps, dtype=np.bool_),
        events=np.zeros((steps, 2, 4), dtype=np.uint8),
        **no_messages(steps + 1, 2),
        layout=np.zeros((0, 8), dtype=np.float32),
        seed=0,
        policy=0,
        end_reason=0,
    )


def test_only_a_termination_stops_the_bootstrap() -> None:
    y = td_target(
        rewards=torch.tensor([1.0, 2.0]),
        terminations=torch.tensor([False, True]),
        next_values=torch.tensor([10.0, 10.0]),
        discount=0.5,
    )
    assert y.tolist() == [6.0, 2.0]


def test_the_team_reward_is_the_mean_over_agents() -> None:
    assert team_reward(torch.tensor([[1.0, 3.0], [0.0, -2.0]])).tolist() == [2.0, -1.0]


def test_the_error_sums_critics_and_averages_rows() -> None:
    q = torch.tensor([[[1.0, 3.0], [0.0, 0.0]]])  # [K, J, B]
    assert td_error(q, torch.tensor([[1.0, 1.0]])).tolist() == [(0 + 4) / 2 + (1 + 1) / 2]


def test_targets_move_by_the_rate_and_leaves_the_online_network_alone() -> None:
    target, online = (StackedMLP(MLPShape(1, (), 1), 1, "cpu") for _ in range(2))
    online.flat.fill_(1.0)
    move_target(target, online, 0.25)
    move_target(target, online, 0.25)
    assert target.flat.tolist() == [[0.4375, 0.4375]]
    assert online.flat.tolist() == [[1.0, 1.0]]


def test_returns_to_go_by_hand() -> None:
    assert returns_to_go([1.0, 0.0, 4.0], 0.5).tolist() == [2.0, 2.0, 4.0]


def test_statistics_count_every_state_and_every_step_and_do_not_cross_episodes() -> None:
    dataset = MemoryDataset([episode([0.0, 4.0], level=1.0), episode([1.0], level=4.0)])
    measured = Statistics.measure(dataset, discount=0.5)
    np.testing.assert_allclose(measured.state_mean, 4 * [(3 * 1 + 2 * 4) / 5])
    np.testing.assert_allclose(measured.state_std, 4 * [np.std([1, 1, 1, 4, 4])])
    np.testing.assert_allclose(measured.observation_mean, 3 * [11 / 5])
    assert measured.max_return == 4.0
    assert measured.return_std == pytest.approx(np.std([2.0, 4.0, 1.0]))


def test_equal_returns_have_a_scale_of_one() -> None:
    measured = Statistics.measure(MemoryDataset([episode([1.0], level=0.0)]), discount=1.0)
    assert measured.return_std == 1.0


def test_an_empty_dataset_cannot_be_measured() -> None:
    with pytest.raises(SchemaError, match="no episodes"):
        Statistics.measure(MemoryDataset([]), discount=1.0)


def test_constant_features_are_only_centered() -> None:
    values = torch.tensor([[3.0, 5.0]])
    out = standardize(values, torch.tensor([1.0, 4.0]), torch.tensor([2.0, 0.0]))
    assert out.tolist() == [[1.0, 1.0]]


def test_agents_see_their_number() -> None:
    out = with_agent_id(torch.zeros(5, 2, 1))
    assert out.shape == (5, 2, 3)
    assert out[4].tolist() == [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


def test_sizes_come_from_the_last_axes_of_a_batch() -> None:
    dataset = MemoryDataset([episode([0.0, 4.0], level=1.0)])
    batch = dataset.sampler(5).gather(np.zeros((3, 5), dtype=np.int64))
    assert Sizes.of(batch) == Sizes(n_agents=2, observation=3, action=2, state=4)
    with pytest.raises(SchemaError, match="action must be at least 1"):
        Sizes(2, 3, 0, 4)
