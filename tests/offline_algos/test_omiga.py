"""OMIGA: the value loss by hand, in-sample targets, weights per agent, and that it improves."""

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.offline_algos.omiga import OMIGA
from tests.offline_algos.toys import made, random_batch, two_episodes


def test_targets_of_two_episodes_are_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    """V = sum_i w_i V_i + b = 100 episode + 10 time, of which the mixer makes all by its b."""
    algorithm = made(OMIGA, discount=0.5, changes={"return_std": 2.0})

    def mix(values: Tensor, x: Tensor, network: object) -> Tensor:
        assert network is algorithm.critics.target_mixer
        return 100 * x[..., 0] + 10 * x[..., 1] + 0 * values.sum(-1)

    monkeypatch.setattr(algorithm, "mixer", mix)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    # episode 1: 2 / 2 + V(1, 1) / 2, then 6 / 2 alone; episode 2: the cut does not stop it
    expected = torch.tensor([[1 + 55.0, 3.0, 1 + 105.0, 3 + 110.0]])
    torch.testing.assert_close(algorithm.targets(batch), expected)


def test_the_value_loss_by_hand() -> None:
    """One agent's z and loss, from slow copies of Q and w and the value network itself."""
    algorithm, batch = made(OMIGA, temperature=0.5), random_batch()
    critics = algorithm.critics
    with torch.no_grad():  # the slow copies count
        critics.target_utilities.flat.mul_(1.5)
        assert critics.target_mixer is not None
        critics.target_mixer.flat.mul_(2.0)
    s, o, a = batch.states, batch.observations, batch.actions  # moments are 0 and 1
    loss, z = algorithm.value_loss(s, o, a)
    q = critics.agent_values(o, a, critics.target_utilities)[:, 0]
    w, _ = algorithm.mixer.weights(torch.cat([s, o.flatten(2)], 2), critics.target_mixer)
    v = algorithm.values(o)[..., 0]
    torch.testing.assert_close(z, w * (q - v) / 0.5)
    torch.testing.assert_close(loss, (z.exp() + w * v / 0.5).mean((1, 2)))


def test_only_the_value_networks_take_the_value_loss() -> None:
    algorithm, batch = made(OMIGA), random_batch()
    loss, _ = algorithm.value_loss(batch.states, batch.observations, batch.actions)
    algorithm.values.network.backward(loss.sum())
    assert algorithm.values.network.gradient.abs().sum() > 0
    assert algorithm.mixer.network is not None
    for network in (algorithm.critics.utilities, algorithm.mixer.network):
        leaves = [weight for weight, _ in network._leaves()]
        fresh, _ = algorithm.value_loss(batch.states, batch.observations, batch.actions)
        found = torch.autograd.grad(fresh.sum(), leaves, allow_unused=True)
        assert all(gradient is None for gradient in found)


def test_agents_draw_rows_by_weights_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm, batch = made(OMIGA, effective_share=0.1), random_batch(size=2)
    z = torch.tensor([[[0.0, 9.0], [9.0, 0.0]]])
    zero = (algorithm.values.network.layers[-1].bias * 0).sum().expand(1)
    monkeypatch.setattr(algorithm, "value_loss", lambda *_: (zero, z))
    errors = (algorithm.actor(batch.observations) - batch.actions).square().mean(3)[0]
    expected = (errors[1, 0] + errors[0, 1]) / 2
    with monkeypatch.context() as patch:
        patch.setattr(algorithm.descent, "step_of", lambda *_: None)
        losses = algorithm.update(batch)
    torch.testing.assert_close(losses["actor_loss"][0], expected.detach())
    assert losses["inverse_temperature"].item() == 1.0
