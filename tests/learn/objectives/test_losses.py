"""Losses, targets and statistics: hand-computed values, what minimizes them, their gradients."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.dataset_statistics import Statistics, returns_to_go
from swarmdata.learn.networks.network_inputs import RobotRewards
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.objectives.losses import (
    anchored_loss,
    batch_weights,
    expectile_loss,
    soft_value_loss,
    standard_advantages,
    td_error,
    td_target,
    tilted_loss,
    value_size,
)
from swarmdata.types import Episode
from tests.offline_algos.toys import statistics
from tests.support.made_episodes import left_early, made_episode
from tests.support.memory_dataset import MemoryDataset

ETA = torch.tensor([2.0])
UNBOUNDED = torch.tensor([float("inf")])


def test_the_anchored_loss_is_least_at_the_mode_of_the_tilted_density() -> None:
    """With Q = g a, the mode of N(m, s^2) exp(eta g a) is m + eta s^2 g."""
    mean, deviation = torch.tensor([[[[0.1, -0.2]]]]), torch.tensor([[[[0.2, 0.3]]]])
    slope = torch.tensor([0.5, -0.25])
    mode = mean + ETA * deviation.square() * slope

    def gradient(pi: Tensor) -> Tensor:
        pi = pi.clone().requires_grad_()
        loss = anchored_loss(pi, (pi * slope).sum(3), mean, deviation, ETA, UNBOUNDED)
        (result,) = torch.autograd.grad(loss.sum(), pi)
        return result

    torch.testing.assert_close(gradient(mode), torch.zeros_like(mode), atol=1e-6, rtol=0)
    assert gradient(mode + 0.1)[..., 0] > 0 > gradient(mode - 0.1)[..., 0]


@pytest.mark.parametrize("height", [0.1, 1.0, 30.0])
def test_a_steep_critic_cannot_pull_actions_further_than_its_bound(height: float) -> None:
    """However steep Q is, descent ends within eta s^2 times the bound of the density's mean."""
    mean, deviation = torch.tensor([[[[0.1, -0.2]]]]), torch.full((1, 1, 1, 2), 0.3)
    direction, steepest = torch.tensor([0.6, -0.8]), torch.tensor([0.5])
    pi = mean.clone().requires_grad_()
    for _ in range(200):
        loss = anchored_loss(pi, height * (pi * direction).sum(3), mean, deviation, ETA, steepest)
        (gradient,) = torch.autograd.grad(loss.sum(), pi)
        pi = (pi - 0.05 * gradient).detach().requires_grad_()
    expected = min(height, 0.5) * ETA * 0.3**2 * direction
    torch.testing.assert_close((pi.detach() - mean)[0, 0, 0], expected, atol=1e-4, rtol=0)


def test_the_tilted_mean_goes_from_the_mean_to_the_best_candidate() -> None:
    candidates = torch.tensor([-0.5, 0.0, 0.8])[None, None, None, :, None]
    values = torch.tensor([0.0, 1.0, 2.0])[None, None, None]
    for eta, mean in ((1e-6, 0.1), (99.0, 0.8)):
        pi = torch.full((1, 1, 1, 1), mean)
        assert tilted_loss(pi, candidates, values, torch.tensor([eta])).item() < 1e-10


def best(loss: object, low: float = -5.0, high: float = 5.0) -> float:
    """The v that minimizes loss(v), to 0.002."""
    values = torch.linspace(low, high, 5001, dtype=torch.float64)
    return float(values[int(loss(values).argmin())])  # type: ignore[operator]


@settings(deadline=None, max_examples=30)
@given(q=st.lists(st.floats(-4, 4), min_size=2, max_size=6), low=st.floats(0.5, 0.95))
def test_expectiles_rise_from_the_mean_to_the_maximum(q: list[float], low: float) -> None:
    qs = torch.tensor(q, dtype=torch.float64)

    def found(expectile: float) -> float:
        return best(lambda v: expectile_loss(qs[:, None] - v, expectile).mean(0))

    assert found(0.5) == pytest.approx(np.mean(q), abs=0.01)
    assert found(low) >= found(0.5) - 0.01
    assert found(0.999) <= max(q) + 0.01
    assert found(0.999) >= found(low) - 0.01


@settings(deadline=None, max_examples=30)
@given(q=st.lists(st.floats(-2, 2), min_size=1, max_size=6))
def test_the_soft_value_is_the_log_mean_exp(q: list[float]) -> None:
    """The loss of OMIGA's V is least where the mean of exp(q - v) is 1."""
    qs = torch.tensor(q, dtype=torch.float64)
    found = best(lambda v: soft_value_loss(qs[:, None] - v, v.expand(len(q), -1), 1e4).mean(0))
    assert found == pytest.approx(math.log(np.mean(np.exp(q))), abs=0.01)
    assert np.mean(q) - 0.01 <= found <= max(q) + 0.01


def soft_slope(q: float, v: float, largest: float) -> tuple[float, float]:
    """The soft value loss of one q and v, and its slope in v."""
    value = torch.tensor(v, dtype=torch.float64, requires_grad=True)
    loss: Tensor = soft_value_loss(q - value, value, largest)
    (slope,) = torch.autograd.grad(loss, value)
    return loss.item(), slope.item()


def test_the_soft_value_loss_by_hand() -> None:
    assert soft_slope(1.0, 0.5, 100.0) == pytest.approx((math.exp(0.5) + 0.5, 1 - math.exp(0.5)))
    # beyond the limit: the tangent at log(10), 10 + 10 (z - log 10)
    z = math.log(10) + 2
    assert soft_slope(z, 0.0, 10.0) == pytest.approx((10 + 10 * 2, 1 - 10))


def episode(rewards: list[float], level: float) -> Episode:
    """2 agents that both get `rewards`; every observation and state is `level`."""
    steps = len(rewards)
    return made_episode(
        np.full((steps + 1, 2, 3), level), np.full((steps + 1, 4), level), np.zeros((steps, 2, 2)),
        np.repeat(np.array(rewards)[:, None], 2, 1), ends=True,
    )  # fmt: skip


def test_only_a_termination_stops_the_bootstrap() -> None:
    y = td_target(
        rewards=torch.tensor([1.0, 2.0]),
        terminations=torch.tensor([False, True]),
        next_values=torch.tensor([10.0, 10.0]),
        discount=0.5,
    )
    assert y.tolist() == [6.0, 2.0]


def test_the_error_sums_critics_and_averages_rows() -> None:
    q = torch.tensor([[[1.0, 3.0], [0.0, 0.0]]])  # [K, J, B]
    assert td_error(q, torch.tensor([[1.0, 1.0]])).tolist() == [(0 + 4) / 2 + (1 + 1) / 2]


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


def test_own_returns_are_those_of_agents_while_they_act() -> None:
    """An agent that has left gets zeros, which nobody learns from."""
    left = left_early(episode([-4.0, -8.0, -6.0], level=1.0))  # agent 0 acts once
    measured = Statistics.measure(MemoryDataset([left, episode([-2.0], level=0.0)]), discount=0.5)
    own = [-4.0, -4 - 4 - 1.5, -8 - 3, -6, -2, -2]
    assert measured.own_return_std == pytest.approx(np.std(own))
    assert measured.own_max_return == -2.0
    assert measured.own_return_range == 16.0
    assert measured.return_std == pytest.approx(np.std([-6.75, -5.5, -3.0, -2.0]))


def test_equal_returns_have_a_scale_of_one() -> None:
    measured = Statistics.measure(MemoryDataset([episode([1.0], level=0.0)]), discount=1.0)
    assert measured.return_std == 1.0


def test_an_empty_dataset_cannot_be_measured() -> None:
    with pytest.raises(SchemaError, match="no episodes"):
        Statistics.measure(MemoryDataset([]), discount=1.0)


def test_sizes_come_from_the_last_axes_of_a_batch() -> None:
    dataset = MemoryDataset([episode([0.0, 4.0], level=1.0)])
    batch = dataset.sampler(5).gather(np.zeros((3, 5), dtype=np.int64))
    assert Sizes.of(batch) == Sizes(n_agents=2, observation=3, action=2, state=4)
    with pytest.raises(SchemaError, match="action must be at least 1"):
        Sizes(2, 3, 0, 4)


CHANGES = {
    "return_std": 2.0, "max_return": 3.0, "return_range": 10.0,
    "own_return_std": 4.0, "own_max_return": 8.0, "own_return_range": 40.0,
}  # fmt: skip


def test_own_rewards_stay_apart_and_have_their_own_scale() -> None:
    rewards = RobotRewards(statistics(**CHANGES), "own", clip_target=True)
    scaled = rewards(torch.tensor([[[1.0, 3.0]]]))
    torch.testing.assert_close(scaled, torch.tensor([[[0.25, 0.75]]]))
    assert (rewards.max_value, rewards.return_range) == (2.0, 10.0)


def test_of_a_team_all_robots_have_the_mean() -> None:
    rewards = RobotRewards(statistics(**CHANGES), "team")
    scaled = rewards(torch.tensor([[[1.0, 3.0]]]))
    torch.testing.assert_close(scaled, torch.tensor([[[1.0, 1.0]]]))
    assert (rewards.max_value, rewards.return_range) == (math.inf, 5.0)


def test_rows_of_robots_that_left_do_not_count() -> None:
    """Means are those of the other rows alone."""
    draw = torch.Generator().manual_seed(0)
    alive = torch.rand(2, 9, 3, generator=draw) < 0.6
    q, y = torch.randn(2, 2, 27, generator=draw), torch.randn(2, 27, generator=draw)
    advantages = torch.randn(2, 9, 3, generator=draw)
    exponents = standard_advantages(advantages, alive)
    weights = batch_weights(exponents, alive)
    for seed in range(2):
        there = alive[seed].flatten()
        seen, wanted = q[seed][:, there][None], y[seed][there][None]
        torch.testing.assert_close(td_error(q, y, alive)[seed], td_error(seen, wanted)[0])
        size = value_size(5 * advantages, alive)[seed]
        torch.testing.assert_close(size, value_size(5 * advantages[seed][alive[seed]][None])[0])
        own = standard_advantages(advantages[seed].flatten()[there].view(1, -1, 1))
        torch.testing.assert_close(exponents[seed].flatten()[there], own.flatten())
        torch.testing.assert_close(weights[seed].flatten()[there], batch_weights(own).flatten())
    assert not weights[~alive].any()


def test_values_divide_by_their_size_but_never_by_less_than_one() -> None:
    """Where values cross 0, a quotient without the floor explodes."""
    small, large = torch.tensor([[0.1, -0.3]]), torch.tensor([[2.0, -4.0]])
    assert value_size(small).item() == 1.0
    assert value_size(large.requires_grad_()).item() == 3.0
    assert not value_size(large).requires_grad


def test_weights_of_advantages_have_a_mean_of_one_and_half_of_the_rows_count() -> None:
    advantages = torch.randn(2, 500, 4, generator=torch.Generator().manual_seed(0))
    weights = batch_weights(0.8 * standard_advantages(1e3 * advantages + 7))
    same = batch_weights(0.8 * standard_advantages(advantages))
    torch.testing.assert_close(weights, same, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(weights.mean((1, 2)), torch.ones(2))
    share = 1 / weights.square().mean((1, 2))
    assert (share - math.exp(-(0.8**2))).abs().max() < 0.1
    order = advantages.flatten(1).argsort(1)
    assert (weights.flatten(1).gather(1, order).diff() >= 0).all()
    one = torch.zeros(1, 500, 1)
    one[0, 0] = 1e6  # a single huge advantage does not take all the weight
    assert batch_weights(0.8 * standard_advantages(one)).max() < 10
    none = batch_weights(standard_advantages(torch.zeros(1, 4, 2)))
    torch.testing.assert_close(none, torch.ones(1, 4, 2))
