"""MADDPG+BC: targets, twins, the two policy gradients, and that it improves on its data."""

from dataclasses import replace

import pytest
import torch

from swarmdata.offline_algos.maddpg_bc import MADDPGBC
from tests.offline_algos.toys import made, random_batch


@pytest.mark.parametrize("critic", ["centralized", "decentralized"])
@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_policy_gradient_is_that_of_the_written_loss(joint_gradient: str, critic: str) -> None:
    """Against autograd, with lambda a constant; critics whose values are far from 0."""
    alpha = 2.5
    algorithm = made(
        MADDPGBC, joint_gradient=joint_gradient, critic=critic, rl_weight=alpha, max_grad_norm=None
    )
    with torch.no_grad():
        algorithm.critics.online.layers[-1].weight.mul_(50.0)
    batch = random_batch()
    x, n = algorithm.critic_inputs(batch), 2
    pi = algorithm.actor(batch.observations)  # [1, B, N, A]
    rows = []
    for robot in range(n):
        joint = pi.clone() if joint_gradient == "all" else batch.actions.clone()
        joint[:, :, robot] = pi[:, :, robot]
        rows.append(algorithm.critics.q(x, joint)[:, 0, :, robot])
    q = torch.stack(rows, -1)
    assert q.abs().mean() > 2
    weight = alpha / q.abs().mean().item()
    loss = -weight * q.mean() + (pi - batch.actions).square().mean()
    algorithm.actor.online.network.backward(loss)
    expected = algorithm.actor.online.network.gradient.clone()
    losses = algorithm.actor_gradient(batch, x, alpha)
    torch.testing.assert_close(
        algorithm.actor.online.network.gradient, expected, rtol=1e-4, atol=1e-6
    )
    assert losses["lambda"].item() == pytest.approx(weight, rel=1e-5)


def test_gradients_of_seeds_are_clipped_apart() -> None:
    algorithm, batch = made(MADDPGBC, 2, max_grad_norm=0.01), random_batch(2)
    rewards = batch.rewards.clone()
    rewards[1] *= 1000
    algorithm.update(replace(batch, rewards=rewards))
    norms = algorithm.critics.online.gradient.view(2, -1).norm(dim=1)
    torch.testing.assert_close(norms, torch.tensor([0.01, 0.01]), rtol=1e-3, atol=0)
