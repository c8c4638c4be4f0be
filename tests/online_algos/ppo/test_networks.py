"""Learned deviations and the scale of value targets."""

import math

import numpy as np
import pytest
import torch
from torch.distributions import Normal

from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.online_algos.ppo.networks import LearnedDeviation, ValueScale


@pytest.mark.parametrize("n_components", [1, 2])
def test_deviations_and_entropy_are_those_of_a_normal(n_components: int) -> None:
    deviation = LearnedDeviation(3, n_components, 0.3)
    torch.testing.assert_close(deviation.std, torch.full((3, 1, n_components), 0.3))
    one = Normal(0.0, 0.3).entropy()  # type: ignore[no-untyped-call]
    torch.testing.assert_close(deviation.entropy, (n_components * one).expand(3))


def test_each_actor_has_its_own() -> None:
    deviation = LearnedDeviation(2, 2, 0.5)
    adam = StackedAdam(deviation.network, 2, 0.1)
    adam.step(-deviation.entropy * torch.tensor([1.0, 0.0]))
    first, second = deviation.std.detach()
    torch.testing.assert_close(first, torch.full((1, 2), 0.5 * math.exp(0.1)))
    torch.testing.assert_close(second, torch.full((1, 2), 0.5))


def test_the_scale_of_a_seed_follows_its_targets_only() -> None:
    scale = ValueScale(2)
    targets = np.zeros((4, 2, 3, 1), np.float32)
    targets[:, 1] = np.array([1.0, 5.0, 1.0, 5.0])[:, None, None]
    for _ in range(3):
        scale.update(targets)
    np.testing.assert_allclose(scale.mean, [0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(scale.std, [0.01, 2.0], atol=1e-9)
    np.testing.assert_allclose(scale.denormalize(scale.normalize(targets)), targets, atol=1e-6)
