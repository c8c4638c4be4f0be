"""Delayed actors and the normalizer: smoothed targets, slow copies, states."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.learn.networks.actor import BehaviorDensity, DelayedActor, StackedActor
from swarmdata.learn.networks.network_inputs import Normalizer
from swarmdata.learn.networks.setup import Setup
from tests.offline_algos.toys import SIZES, statistics

MOMENTS = replace(
    statistics(),
    observation_mean=np.array([1.0, 2.0, 3.0]), observation_std=np.array([2.0, 1.0, 0.0]),
    state_mean=np.full(4, 5.0), state_std=np.full(4, 0.5),
)  # fmt: skip


def made(n_seeds: int = 2) -> DelayedActor:
    online = StackedActor(Setup(SIZES, range(n_seeds), MOMENTS), (8,), squash=True)
    return DelayedActor(online, n_seeds, learning_rate=1e-2, max_norm=None)


def test_features_are_normalized_with_the_datasets_moments() -> None:
    normalizer = Normalizer(MOMENTS, "cpu")
    seen = normalizer.observations(torch.tensor([3.0, 3.0, 4.0]))
    assert seen.tolist() == [1.0, 1.0, 1.0]  # a constant feature is only centered
    assert normalizer.states(torch.full((2, 4), 6.0)).tolist() == [[2.0] * 4] * 2


@settings(deadline=None, max_examples=20)
@given(largest=st.floats(0.01, 0.5), seed=st.integers(0, 100))
def test_smoothing_is_clipped_and_stays_in_range(largest: float, seed: int) -> None:
    actor = made()
    generator = torch.Generator().manual_seed(seed)
    observations, noise = (torch.randn(2, 30, 2, n, generator=generator) for n in (3, 2))
    plain = actor(observations)
    noisy = actor.smoothed(noise, observations, 1.0, largest)
    assert (noisy - plain).abs().max() <= largest + 1e-6
    assert noisy.abs().max() <= 1
    assert not torch.equal(noisy, plain)


def test_targets_come_from_the_slow_copies() -> None:
    actor, observations = made(), torch.randn(2, 5, 2, 3)
    before = actor(observations).detach()
    actor.step(actor(observations).square().mean((1, 2, 3)))
    noise = torch.zeros(2, 5, 2, 2)
    assert torch.equal(actor.smoothed(noise, observations, 1.0, 0.1), before)
    assert not torch.equal(actor(observations), before)
    actor.follow(1.0)
    assert torch.equal(actor.smoothed(noise, observations, 1.0, 0.1), actor(observations))


def density_of(floor: float = 0.01) -> BehaviorDensity:
    actor = StackedActor(Setup(SIZES, [0], statistics()), (32,), squash=True)
    return BehaviorDensity(actor, [0], floor=floor, learning_rate=1e-2, max_norm=None)


@pytest.mark.learns
def test_mean_and_deviation_are_learned_where_they_differ() -> None:
    density, generator = density_of(), torch.Generator().manual_seed(0)
    for _ in range(600):
        o = torch.rand(1, 128, 2, 3, generator=generator) * 2 - 1
        is_left = o[..., :1] < 0
        deviation = torch.where(is_left, 0.08, 0.3)
        noise = torch.randn(1, 128, 2, 2, generator=generator)
        density.gradient(o, torch.where(is_left, -0.4, 0.4) + deviation * noise)
        density.descend()
    o = torch.tensor([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.0]])[None, :, None].expand(1, 2, 2, 3)
    mean, deviation = density.moments(o, torch.zeros(1, 2, 2, 2))
    torch.testing.assert_close(mean[0, :, 0, 0], torch.tensor([-0.4, 0.4]), atol=0.06, rtol=0)
    torch.testing.assert_close(deviation[0, :, 0, 0], torch.tensor([0.08, 0.3]), atol=0.05, rtol=0)


def test_the_loss_is_the_gaussians_without_its_constant() -> None:
    density = density_of()
    o, a = torch.randn(1, 16, 2, 3), torch.rand(1, 16, 2, 2) - 0.5
    mean, deviation = density.moments(o, a)
    normal = torch.distributions.Normal(mean, deviation)
    log_probs = normal.log_prob(a)  # type: ignore[no-untyped-call]
    expected = -(log_probs + 0.5 * torch.log(torch.tensor(2 * torch.pi))).sum(3).mean()
    torch.testing.assert_close(density.gradient(o, a)[0], expected)


def test_the_mean_descends_the_squared_error_whatever_the_deviation() -> None:
    """The head's gradient of the mean: that of 1/2 |m - a|^2, the mean over rows and robots."""
    density = density_of()
    o, a = torch.randn(1, 16, 2, 3), torch.rand(1, 16, 2, 2) - 0.5
    mean, _ = density.moments(o, a)
    density.gradient(o, a)
    bias = density.network.gradient[0, -4:-2]  # of the two means before tanh
    expected = ((mean - a) * (1 - mean.square())).mean((0, 1, 2))
    torch.testing.assert_close(bias, expected)


def test_deviations_have_a_floor() -> None:
    o, a = torch.randn(1, 16, 2, 3), torch.zeros(1, 16, 2, 2)
    assert density_of(floor=5.0).moments(o, a)[1].min() == 5.0
