"""Multi-agent IQL: in-sample targets, expectile values, joint weights, and that it improves."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.critics import RobotView
from swarmdata.offline_algos.iql import IQL
from swarmdata.offline_algos.omiga import OMIGA
from swarmdata.types import Batch
from tests.offline_algos.toys import made, random_batch, trained, two_episodes
from tests.support.memory_dataset import MemoryDataset


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()

    def value(view: RobotView) -> Tensor:
        states = view.features[..., 3 + 2 :]  # after the observation and the robot's number
        return 100 * states[..., 0] + 10 * states[..., 1]

    # episode 1: r / 2 + V(1, 1) / 2, then r / 2 alone; episode 2: the cut does not stop it
    own = [[0.5 + 55.0, 1.5 + 55.0], [2.5, 3.5], [0.5 + 105.0, 1.5 + 105.0], [112.5, 113.5]]
    team = [[1 + 55.0] * 2, [3.0] * 2, [1 + 105.0] * 2, [3 + 110.0] * 2]
    scales = {"return_std": 2.0, "own_return_std": 2.0}
    for reward, expected in (("own", own), ("team", team)):
        algorithm = made(IQL, discount=0.5, changes=scales, critic="centralized", reward=reward)
        monkeypatch.setattr(algorithm, "values", value)
        torch.testing.assert_close(algorithm.targets(batch), torch.tensor([expected]))
        # robot 0 ends with its first step in episode 2, and is absent in the next one
        there, leaves = (
            torch.ones(1, 4, 2, dtype=torch.bool),
            torch.zeros(1, 4, 2, dtype=torch.bool),
        )
        there[0, 3, 0], leaves[0, 2, 0] = False, True
        left = replace(batch, alive=there, next_alive=there, agent_terminations=leaves)
        ended = torch.tensor([expected])
        if reward == "own":
            ended[0, 2:, 0] = torch.tensor([0.5, 2.5])
        torch.testing.assert_close(algorithm.targets(left), ended)


@pytest.mark.parametrize("kind", [IQL, OMIGA])
def test_no_policy_enters_the_critics(kind: Any) -> None:
    """Two algorithms that differ in their actors only learn the same values."""
    ours, other, batch = made(kind), made(kind), random_batch()
    other.actor.network.flat.mul_(-2)
    for algorithm in (ours, other):
        for _ in range(5):
            algorithm.update(batch)
    own = {"actor", "actor_adam.exp_avg", "actor_adam.exp_avg_sq"}
    for name, tensor in ours.state_dict().items():
        assert torch.equal(tensor, other.state_dict()[name]) == (name not in own), name


def test_the_rows_of_the_robots_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Minimum of the twins, advantage, unit, exponential; each robot's rows by its own weights."""
    changes = {"own_return_range": 2000.0}  # beta 2 is 1 in units of the rewards
    algorithm = made(
        IQL, changes=changes, inverse_temperature=2.0, effective_share=0.1, max_grad_norm=None
    )
    batch = random_batch(size=2)
    twins = [[[0.5, 1.0], [90.0, 0.25]], [[1.5, 99.0], [99.0, 0.5]]]
    monkeypatch.setattr(algorithm.critics, "target_q", lambda *_: torch.tensor([twins]))
    with torch.no_grad():
        algorithm.value.flat.zero_()
    added, add = [], algorithm.rows.add

    def noted(batch: Batch, advantages: Tensor, alive: Tensor | None) -> None:
        added.append(advantages)
        add(batch, advantages, alive)

    monkeypatch.setattr(algorithm.rows, "add", noted)
    _, pi = algorithm.actor.along(batch)
    errors = (pi - batch.actions).square().mean(3)[0].detach()  # [B, N]
    losses = algorithm.update(batch)
    # u q: half the smaller twin. The first robot's second row outweighs all others.
    torch.testing.assert_close(added[0], torch.tensor([[[0.25, 0.5], [45.0, 0.125]]]))
    beta = losses["inverse_temperature"].item()
    assert 0 < beta <= 2
    shares = (beta * added[0][0, :, 1]).softmax(0)  # the second robot draws two rows
    assert 0.5 <= shares[0] < 0.8
    both = [errors[1, 0] + pair for pair in (errors[:, 1].mean(), errors[0, 1])]
    assert any(torch.isclose(losses["actor_loss"][0], each / 2) for each in both)
    # tau = 0.7, all advantages 0.5, 1, 90, 0.25 are above: 0.7 u^2
    expected = torch.tensor([0.7 * (0.25 + 1 + 8100 + 0.0625) / 4])
    torch.testing.assert_close(losses["value_loss"], expected)


def test_without_a_temperature_it_clones(mixture: MemoryDataset) -> None:
    _, losses = trained(IQL, mixture, 5, inverse_temperature=0.0)
    clone, _ = trained(IQL, mixture, 5, effective_share=1.0)
    other, _ = trained(IQL, mixture, 5, inverse_temperature=0.0, effective_share=1.0)
    assert torch.equal(clone.actor.network.flat, other.actor.network.flat)
    assert all(row["inverse_temperature"] == 0.0 for row in losses)


def test_a_large_beta_does_not_overflow() -> None:
    algorithm, batch = made(IQL, inverse_temperature=1e6), random_batch()
    losses = algorithm.update(replace(batch, rewards=1e3 * batch.rewards))
    assert all(torch.isfinite(loss).all() for loss in losses.values())
