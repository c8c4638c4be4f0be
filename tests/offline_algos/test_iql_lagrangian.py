"""IQL with a Lagrangian: the multiplier, and that contacts stay within the budget."""

from dataclasses import replace
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.offline_algos.iql import IQL  # noqa: E402
from swarmdata.offline_algos.iql_lagrangian import IQLLagrangian, IQLLagrangianConfig  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import made, random_batch  # noqa: E402


def fast_or_careful(size: int = 64) -> Batch:
    """Episodes of one step: half of the robots' first actions are 1, which earns 1 and touches."""
    batch = random_batch(size=size)
    fast = (torch.arange(size) % 2 == 0).float()[None, :, None].expand(1, size, 2)
    actions = torch.zeros_like(batch.actions)
    actions[..., 0] = 1.6 * fast - 0.8
    costs = torch.stack([fast, torch.zeros_like(fast)], -1)
    ends = torch.ones_like(batch.terminations)
    flags = {"terminations": ends, "truncations": ~ends}
    return replace(batch, actions=actions, rewards=fast.clone(), costs=costs, **flags)


def taught(n_updates: int = 150, **config: Any) -> tuple[Any, dict[str, Any]]:
    settings = {"critic_learning_rate": 0.01, "actor_learning_rate": 0.01, **config}
    algorithm = made(IQLLagrangian, changes={"own_return_range": 1.0}, **settings)
    batch = fast_or_careful()
    for _ in range(n_updates):
        losses = algorithm.update(batch)
    return algorithm, losses


@pytest.mark.parametrize(
    ("budget", "cost", "is_fast"),
    [(0.3, "all", False), (3.0, "all", True), (0.3, "obstacle_collisions", True)],
)
def test_the_budget_decides_between_fast_and_careful(
    budget: float, cost: str, is_fast: bool
) -> None:
    """Two robots that are fast cost 2 an episode."""
    algorithm, losses = taught(budget=budget, cost=cost, multiplier_rate=0.05)
    first = algorithm.actor(fast_or_careful().observations)[..., 0]
    assert (first.mean() > 0.4) == is_fast
    assert (first.mean() < -0.4) == (not is_fast)
    assert (losses["multiplier"] > 0.5).all() == (not is_fast)


def test_the_cost_of_an_episode_is_that_of_the_policy() -> None:
    _, losses = taught(budget=50.0)
    assert losses["episode_cost"].item() == pytest.approx(2.0, abs=0.3)
    assert losses["multiplier"].item() == 0.0


def test_without_a_price_of_contacts_it_is_iql() -> None:
    batch = replace(random_batch(2), costs=torch.rand(2, 32, 2, 2))
    ours, plain = made(IQLLagrangian, 2, budget=1e9), made(IQL, 2)
    for algorithm in (ours, plain):
        for _ in range(4):
            algorithm.update(batch)
    assert torch.equal(ours.actor.network.flat, plain.actor.network.flat)
    assert torch.equal(ours.critics.online.flat, plain.critics.online.flat)


def test_data_without_events_are_refused() -> None:
    with pytest.raises(SchemaError, match="no costs"):
        made(IQLLagrangian).update(random_batch())


@pytest.mark.parametrize("name", ["budget", "multiplier_rate"])
def test_numbers_are_positive(name: str) -> None:
    settings: dict[str, Any] = {name: 0.0}
    with pytest.raises(SchemaError, match=f"{name} is 0"):
        IQLLagrangianConfig(**settings)
