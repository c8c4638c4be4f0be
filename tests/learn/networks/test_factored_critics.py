"""Factored critics: values by hand, twins that differ, constants in the policies' loss."""

import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.factored_critics import FactoredCritics
from swarmdata.learn.networks.mixers import MIXER_STREAM, HyperMixer, MeanMixer
from swarmdata.learn.networks.perceptrons import mlp
from swarmdata.learn.networks.setup import Setup, Sizes
from tests.offline_algos.toys import statistics

SIZES = Sizes(n_agents=3, observation=4, action=2, state=5)
SEEDS = (3, 8)


SETUP = Setup(SIZES, SEEDS, statistics())


def made(is_monotonic: bool) -> FactoredCritics:
    mixer = HyperMixer(
        3, SIZES.information, SEEDS, MIXER_STREAM, embedding=7, hidden=6, device="cpu",
        n_critics=2, is_monotonic=is_monotonic,
    )  # fmt: skip
    return FactoredCritics(SETUP, (8,), mixer, learning_rate=1e-2, max_norm=None)


def drawn(n_seeds: int = 2) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    shapes = (n_seeds, 6, 5), (n_seeds, 6, 3, 4), (n_seeds, 6, 3, 2)
    states, observations, actions = (torch.randn(s, generator=generator) for s in shapes)
    return states, observations, actions.tanh()


@pytest.mark.parametrize("is_monotonic", [False, True])
def test_a_value_by_hand(is_monotonic: bool) -> None:
    """Seed 1, twin 0, row 4: three utilities of one network, then the mixer."""
    critics, (s, o, a) = made(is_monotonic), drawn()
    row = 2 * 1 + 0
    layers = critics.utilities.extract(row, torch.float32)
    identity = torch.eye(3)
    own = torch.stack(
        [
            mlp(layers, torch.cat([o[1, 4, i], a[1, 4, i], identity[i]])[None, None])
            for i in range(3)
        ]
    ).flatten()
    assert critics.mixer.network is not None
    x = torch.cat([s[1, 4], o[1, 4].flatten()])
    raw = mlp(critics.mixer.network.extract(row, torch.float32), x[None, None]).flatten()
    first, second = raw[:21].view(3, 7), raw[28:35]
    if is_monotonic:
        first, second = first.abs(), second.abs()
    hidden = torch.nn.functional.elu(own @ first / 3 + raw[21:28])
    q = critics.q(s, o, a)
    assert q.shape == (2, 2, 6)
    torch.testing.assert_close(q[1, 0, 4], (hidden * second).sum() + raw[35])
    torch.testing.assert_close(critics.agent_values(o, a)[1, 0, 4], own)


@pytest.mark.parametrize("is_monotonic", [False, True])
def test_policy_values_are_the_first_twins_with_constant_parameters(is_monotonic: bool) -> None:
    critics, (s, o, a) = made(is_monotonic), drawn()
    pi = a.clone().requires_grad_()
    values = critics.policy_values(s, o, pi)
    torch.testing.assert_close(values, critics.q(s, o, a)[:, 0])
    (slope,) = torch.autograd.grad(values.sum(), pi)
    free = a.clone().requires_grad_()
    (expected,) = torch.autograd.grad(critics.q(s, o, free)[:, 0].sum(), free)
    torch.testing.assert_close(slope, expected)
    leaves = [weight for weight, _ in critics.utilities._leaves()]
    with pytest.raises(RuntimeError, match="not have been used"):
        torch.autograd.grad(critics.policy_values(s, o, pi).sum(), leaves[:1])


def test_a_mixer_without_parameters_is_possible() -> None:
    critics = FactoredCritics(SETUP, (8,), MeanMixer(), learning_rate=1e-2, max_norm=1.0)
    s, o, a = drawn()
    torch.testing.assert_close(critics.q(s, o, a), critics.agent_values(o, a).mean(-1))
    torch.testing.assert_close(critics.policy_values(s, o, a), critics.q(s, o, a)[:, 0])
    critics.step(critics.q(s, o, a).square().mean((1, 2)))
    critics.follow(0.5)
    assert not any(name.startswith("mixer") for name in critics.state_dict())
