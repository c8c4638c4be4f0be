"""IQL with costs: targets and preferences by hand, and a weight that decides what is learned."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from swarmdata.errors import SchemaError
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.offline_algos.iql import IQL
from swarmdata.offline_algos.iql_cost import IQLCost
from swarmdata.types import EVENTS, Episode
from tests.offline_algos.toys import actions_of, made, random_batch, trained
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset


def risky_or_safe(n_episodes: int = 100, length: int = 10) -> Iterator[Episode]:
    """Robots that go right get 1 and hit something in half of the steps; left, 0.5 and nothing."""
    rng = np.random.default_rng(0)
    for number in range(n_episodes):
        right = rng.random((length, 2)) < 0.5
        actions = np.zeros((length, 2, 2))
        actions[..., 0] = np.where(right, 0.8, -0.8) + rng.normal(0, 0.05, right.shape)
        observations = rng.normal(size=(length + 1, 2, 3))
        states = rng.normal(size=(length + 1, 4))
        rewards = np.where(right, 1.0, 0.5)
        episode = made_episode(observations, states, actions, rewards, ends=False, seed=number)
        contacts = right & (rng.random(right.shape) < 0.5)
        episode.events[..., EVENTS.index("obstacle_onsets")] = contacts
        yield episode


@pytest.mark.parametrize(
    ("weight", "side", "n_updates"),
    [pytest.param(0.0, 1.0, 200, marks=pytest.mark.slow), (1000.0, -1.0, 100)],
)
def test_the_weight_decides_between_reward_and_safety(
    weight: float, side: float, n_updates: int
) -> None:
    data = MemoryDataset(list(risky_or_safe()))
    algorithm, _ = trained(IQLCost, data, n_updates, seeds=(0,), cost_weight=weight, discount=0.5)
    observations = next(iter(data)).observations
    sides = np.sign(actions_of(algorithm.policy(0), observations)[..., 0])
    assert (sides == side).mean() > 0.9


@pytest.mark.parametrize(
    ("cost", "expected"), [("robot_collisions", 1.0), ("obstacle_collisions", 5.0), ("all", 6.0)]
)
def test_targets_have_the_chosen_costs(
    cost: str, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Values of 8 count half unless the task has ended."""
    algorithm, batch = made(IQLCost, cost=cost, discount=0.5), random_batch(size=4)
    ends = torch.tensor([[True, False, True, False]])
    costs = torch.tensor([1.0, 5.0]).expand(1, 4, 2, 2)
    monkeypatch.setattr(algorithm, "cost_values", lambda x: torch.full((1, 4, 2), 8.0))
    found = algorithm.cost_targets(replace(batch, costs=costs, terminations=ends))
    following = torch.tensor([0.0, 4.0, 0.0, 4.0])[None, :, None].expand(1, 4, 2)
    torch.testing.assert_close(found, expected + following)


def test_preferences_are_advantages_less_weighted_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The larger of two critics counts, times lambda, against the value of the costs."""
    algorithm, batch = made(IQLCost, cost_weight=4.0), random_batch(size=2)
    twins = torch.tensor([[[[0.5, 1.0], [2.0, 0.25]], [[1.5, 0.0], [1.0, 0.5]]]])
    monkeypatch.setattr(algorithm.cost_critics, "target_q", lambda *_: twins)
    with torch.no_grad():
        algorithm.cost_value.flat.zero_()
    x = algorithm.critics.view(batch.states, batch.observations)
    advantages = torch.full((1, 2, 2), 7.0)
    found, losses = algorithm.prefer(batch, x, batch.actions, advantages)
    largest = torch.tensor([[[1.5, 1.0], [2.0, 0.5]]])
    torch.testing.assert_close(found, 7 - 4 * largest)
    assert losses["cost_value_loss"].item() == pytest.approx(largest.square().mean().item())


def test_rewards_are_valued_as_in_iql() -> None:
    ours, other, batch = made(IQLCost), made(IQL), random_batch()
    for algorithm in (ours, other):
        for _ in range(5):
            algorithm.update(batch)
    assert torch.equal(ours.critics.online.flat, other.critics.online.flat)
    assert torch.equal(ours.value.flat, other.value.flat)
    assert not torch.equal(ours.actor.network.flat, other.actor.network.flat)


def test_data_without_events_have_no_costs(tmp_path: Path) -> None:
    episodes = [replace(e, events=e.events[..., :0]) for e in risky_or_safe(3)]
    with pytest.raises(SchemaError, match="iql_cost learns from costs"):
        train_seeds("iql_cost", MemoryDataset(episodes), tmp_path / "run", progress=False)
    assert not list(tmp_path.iterdir())
