"""Delayed actors and the normalizer: smoothed targets, slow copies, states."""

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.learn.networks.actor import DelayedActor, StackedActor
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
