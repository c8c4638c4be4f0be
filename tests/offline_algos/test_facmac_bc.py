"""FACMAC+BC: targets, the centralized policy gradient, and that it improves on its data."""

from typing import get_args

import pytest
import torch

from swarmdata.learn.networks.mixers import MixerKind
from swarmdata.learn.objectives.losses import cloning_loss
from swarmdata.offline_algos.facmac_bc import FACMACBC
from tests.offline_algos.toys import made, random_batch


@pytest.mark.parametrize("mixer", get_args(MixerKind))
def test_the_policy_gradient_is_that_of_the_written_loss(mixer: str) -> None:
    """Every agent's action is the policy's; lambda is a constant; the critics do not move."""
    algorithm = made(FACMACBC, mixer=mixer, rl_weight=0.6, max_grad_norm=None)
    batch, critics = random_batch(), algorithm.critics
    with torch.no_grad():
        critics.utilities.layers[-1].weight.mul_(200.0)
    before = critics.state_dict()
    pi = algorithm.actor(batch.observations)
    q = critics.q(batch.states, batch.observations, pi)[:, 0]  # moments are 0 and 1
    weight = 0.6 / max(q.abs().mean().item(), 1.0)
    loss = -weight * q.mean() + (pi - batch.actions).square().mean()
    network = algorithm.actor.online.network
    network.backward(loss)
    expected = network.gradient.clone()
    pi = algorithm.actor(batch.observations)
    bc_loss = cloning_loss(pi, batch.actions)
    total, reported = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, bc_loss)
    algorithm.actor.step(total)
    torch.testing.assert_close(network.gradient, expected, rtol=1e-4, atol=1e-6)
    assert reported["lambda"].item() == pytest.approx(weight, rel=1e-5)
    for name, tensor in critics.state_dict().items():
        assert torch.equal(tensor, before[name]), name


def test_a_robot_is_pulled_as_hard_in_a_team_of_any_size() -> None:
    """N times the slope of each term, a mean, in one robot's action is that robot's own."""
    algorithm, batch = made(FACMACBC, mixer="mean"), random_batch()
    pi = torch.zeros(1, 32, 2, 2, requires_grad=True)
    none = torch.zeros(1)
    value, _ = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, none)
    data = cloning_loss(pi, batch.actions)
    (of_value,), (of_data,) = (torch.autograd.grad(x.sum(), pi) for x in (value, data))
    q = algorithm.critics.agent_values(batch.observations, pi)[:, 0]  # [K, B, N]
    assert q.mean(2).abs().mean() < 1  # lambda is alpha
    (own_value,) = torch.autograd.grad(-algorithm.config.rl_weight * q[..., 0].mean(), pi)
    (own_data,) = torch.autograd.grad((pi - batch.actions)[:, :, 0].square().mean(), pi)
    torch.testing.assert_close(2 * of_value[:, :, 0], own_value[:, :, 0])
    torch.testing.assert_close(2 * of_data[:, :, 0], own_data[:, :, 0])
