"""Delayed actors and the normalizer: smoothed targets, slow copies, states."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from swarmdata.learn.networks.actor import DelayedActor, StackedActor  # noqa: E402
from swarmdata.learn.networks.network_inputs import generators  # noqa: E402
from swarmdata.learn.networks.normalizer import Normalizer  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.learn.training.dataset_statistics import Statistics  # noqa: E402

SIZES = Sizes(n_agents=2, observation=3, action=2, state=4)


def statistics() -> Statistics:
    return Statistics(
        observation_mean=np.array([1.0, 2.0, 3.0]),
        observation_std=np.array([2.0, 1.0, 0.0]),
        state_mean=np.full(4, 5.0),
        state_std=np.full(4, 0.5),
        return_std=1.0,
        max_return=1.0,
        own_return_std=1.0,
        own_max_return=1.0,
        return_range=10.0,
        own_return_range=20.0,
    )


def made(n_seeds: int = 2) -> DelayedActor:
    online = StackedActor(SIZES, range(n_seeds), (8,), statistics(), squash=True, device="cpu")
    return DelayedActor(online, n_seeds, learning_rate=1e-2, max_norm=None)


def test_features_are_normalized_with_the_datasets_moments() -> None:
    normalizer = Normalizer(statistics(), "cpu")
    seen = normalizer.observations(torch.tensor([3.0, 3.0, 4.0]))
    assert seen.tolist() == [1.0, 1.0, 1.0]  # a constant feature is only centered
    assert normalizer.states(torch.full((2, 4), 6.0)).tolist() == [[2.0] * 4] * 2


@settings(deadline=None, max_examples=20)
@given(largest=st.floats(0.01, 0.5), seed=st.integers(0, 100))
def test_smoothing_is_clipped_and_stays_in_range(largest: float, seed: int) -> None:
    actor = made()
    observations = torch.randn(2, 30, 2, 3, generator=torch.Generator().manual_seed(seed))
    plain = actor(observations)
    noisy = actor.smoothed(observations, generators([seed, 1], "cpu"), 1.0, largest)
    assert (noisy - plain).abs().max() <= largest + 1e-6
    assert noisy.abs().max() <= 1
    assert not torch.equal(noisy, plain)


def test_targets_come_from_the_slow_copies() -> None:
    actor, observations = made(), torch.randn(2, 5, 2, 3)
    before = actor(observations).detach()
    actor.step(actor(observations).square().mean((1, 2, 3)))
    noise = generators([0, 1], "cpu")
    assert torch.equal(actor.smoothed(observations, noise, 0.0, 0.1), before)
    assert not torch.equal(actor(observations), before)
    actor.follow(1.0)
    assert torch.equal(actor.smoothed(observations, noise, 0.0, 0.1), actor(observations))


def test_a_restored_state_goes_on_alike() -> None:
    actor, other, observations = made(), made(), torch.randn(2, 5, 2, 3)
    actor.step(actor(observations).square().mean((1, 2, 3)))
    other.load_state_dict(actor.state_dict())
    for each in (actor, other):
        each.step(each(observations).square().mean((1, 2, 3)))
        each.follow(0.5)
    assert torch.equal(actor.online.network.flat, other.online.network.flat)
    assert torch.equal(actor.target.flat, other.target.flat)
