"""The clipped objective: gradients where a step may go on, none beyond the clip."""

import math

import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import Normal

from swarmdata.online_algos.ppo.clipping import clipped_losses

STD, CLIP = 0.4, 0.2


def log_probs(means: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
    """Without the constant, as `clipped_losses` takes them."""
    full: torch.Tensor = Normal(means, STD).log_prob(actions).sum(-1)  # type: ignore[no-untyped-call]
    return full + actions.shape[-1] * 0.5 * math.log(2 * math.pi)


def samples(seed: int) -> tuple[torch.Tensor, ...]:
    """Means, actions, old log-probabilities and advantages of 3 networks."""
    g = torch.Generator().manual_seed(seed)
    old = torch.randn(3, 64, 2, generator=g, dtype=torch.float64)
    actions = old + STD * torch.randn(old.shape, generator=g, dtype=torch.float64)
    means = old + 0.1 * torch.randn(old.shape, generator=g, dtype=torch.float64)
    advantages = torch.randn(3, 64, generator=g, dtype=torch.float64)
    return means.requires_grad_(), actions, log_probs(old, actions), advantages


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_it_is_the_equation(seed: int) -> None:
    means, actions, old, advantages = samples(seed)
    losses, kl = clipped_losses(means, actions, old, advantages, std=STD, clip=CLIP)
    ratio = (log_probs(means, actions) - old).exp()
    plain, bounded = ratio * advantages, ratio.clamp(1 - CLIP, 1 + CLIP) * advantages
    torch.testing.assert_close(losses, -torch.minimum(plain, bounded))
    assert (kl >= 0).all()
    assert not kl.requires_grad


def test_what_has_moved_far_enough_moves_no_more() -> None:
    means, actions, old, advantages = samples(0)
    losses, _ = clipped_losses(means, actions, old, advantages, std=STD, clip=CLIP)
    (gradient,) = torch.autograd.grad(losses.sum(), [means])
    moves = (gradient != 0).any(-1)
    ratio = (log_probs(means, actions) - old).exp()
    done = (ratio > 1 + CLIP) & (advantages > 0) | (ratio < 1 - CLIP) & (advantages < 0)
    assert done.any()
    assert not done.all()
    assert torch.equal(moves, ~done)


def test_the_policy_that_acted_has_no_divergence() -> None:
    means, actions, _, advantages = samples(1)
    own = log_probs(means, actions).detach()
    losses, kl = clipped_losses(means, actions, own, advantages, std=STD, clip=CLIP)
    torch.testing.assert_close(losses, -advantages)
    torch.testing.assert_close(kl, torch.zeros_like(kl))
