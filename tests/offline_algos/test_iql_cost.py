"""IQL-Lagrangian: targets and weights of costs by hand, and a budget that decides what is learned."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.learn.training.trainer import train_seeds  # noqa: E402
from swarmdata.offline_algos.iql import IQL  # noqa: E402
from swarmdata.offline_algos.iql_lag import IQLLag, IQLLagConfig  # noqa: E402
from swarmdata.types import EVENTS, Episode  # noqa: E402
from tests.offline_algos.toys import actions_of, made, random_batch, trained  # noqa: E402
from tests.support.made_episodes import made_episode  # noqa: E402
from tests.support.memory_dataset import MemoryDataset  # noqa: E402

ONSETS = EVENTS.index("robot_onsets"), EVENTS.index("obstacle_onsets")


def risky_or_safe(n_episodes: int = 200, length: int = 10) -> Iterator[Episode]:
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
        episode.events[..., ONSETS[1]] = right & (rng.random(right.shape) < 0.5)
        yield episode


@pytest.mark.parametrize(("budget", "side"), [(0.1, -1.0), (100.0, 1.0)])
def test_the_budget_decides_between_reward_and_safety(budget: float, side: float) -> None:
    data = MemoryDataset(list(risky_or_safe()))
    algorithm, losses = trained(
        IQLLag, data, 400, budget=budget, discount=0.5, multiplier_rate=0.05
    )
    observations = next(iter(data)).observations
    for index in range(2):
        sides = np.sign(actions_of(algorithm.policy(index), observations)[..., 0])
        assert (sides == side).mean() > 0.9
    first, last = losses[0]["multiplier"], losses[-1]["multiplier"]
    assert (last > first) == (side < 0)


def test_an_episode_of_values_is_its_cost() -> None:
    """Robots that hit something in every second step: V = 0.5 / (1 - gamma), for 20 steps 10."""
    algorithm = made(IQLLag, discount=0.5, changes={"episode_length": 20.0})
    values = torch.full((1, 8, 2), 0.5 / (1 - 0.5))
    torch.testing.assert_close(algorithm.episode_cost(values), torch.tensor([2 * 10.0]))
    assert algorithm.episode_cost(-values).item() == 0.0


@pytest.mark.parametrize(
    ("cost", "expected"), [("robot_collisions", 1.0), ("obstacle_collisions", 5.0), ("all", 6.0)]
)
def test_targets_have_the_chosen_costs(
    cost: str, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Values of 8 count half unless the task has ended."""
    algorithm, batch = made(IQLLag, cost=cost, discount=0.5), random_batch(size=4)
    ends = torch.tensor([[True, False, True, False]])
    costs = torch.tensor([1.0, 5.0]).expand(1, 4, 2, 2)
    monkeypatch.setattr(algorithm, "cost_values", lambda x: torch.full((1, 4, 2), 8.0))
    found = algorithm.cost_targets(replace(batch, costs=costs, terminations=ends))
    following = torch.tensor([0.0, 4.0, 0.0, 4.0])[None, :, None].expand(1, 4, 2)
    torch.testing.assert_close(found, expected + following)


def test_preferences_are_advantages_less_weighted_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The larger of two critics counts, times lambda, against the value of the costs."""
    algorithm, batch = made(IQLLag, multiplier=4.0), random_batch(size=2)
    twins = torch.tensor([[[[0.5, 1.0], [2.0, 0.25]], [[1.5, 0.0], [1.0, 0.5]]]])
    monkeypatch.setattr(algorithm.cost_critics, "target_q", lambda *_: twins)
    with torch.no_grad():
        algorithm.cost_value.flat.zero_()
    x = algorithm.critics.view(batch.states, batch.observations)
    advantages = torch.tensor([[[7.0, 7.0], [7.0, 7.0]]])
    found, losses = algorithm.prefer(batch, x, batch.actions, advantages)
    torch.testing.assert_close(found, 7 - 4 * torch.tensor([[[1.5, 1.0], [2.0, 0.5]]]))
    assert losses["multiplier"].item() < 4.0  # no cost yet is below the budget


def test_values_of_costs_are_those_of_the_policy_that_is_learned() -> None:
    """Weights that all but rule out the costly half of the rows leave half of their cost at most."""
    data = MemoryDataset(list(risky_or_safe()))
    cautious, careless = (
        trained(IQLLag, data, 400, budget=budget, discount=0.5, multiplier_rate=0.05)[1]
        for budget in (0.0, 100.0)
    )
    assert cautious[-1]["episode_cost"] < 0.5 * careless[-1]["episode_cost"]


def test_rewards_are_valued_as_in_iql() -> None:
    ours, other, batch = made(IQLLag), made(IQL), random_batch()
    for algorithm in (ours, other):
        for _ in range(5):
            algorithm.update(batch)
    assert torch.equal(ours.critics.online.flat, other.critics.online.flat)
    assert torch.equal(ours.value.flat, other.value.flat)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"budget": -0.1}, "budget is -0.1"),
        ({"multiplier_rate": 0.0}, "multiplier_rate 0.0"),
        ({"multiplier": 0.0}, "multiplier is 0.0"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], words: str) -> None:
    with pytest.raises(SchemaError, match=words):
        IQLLagConfig(**settings)


def test_data_without_events_have_no_costs(tmp_path: object) -> None:
    episodes = [replace(e, events=e.events[..., :0]) for e in risky_or_safe(3)]
    with pytest.raises(SchemaError, match="iql_lag learns from costs"):
        train_seeds("iql_lag", MemoryDataset(episodes), f"{tmp_path}/run", progress=False)
