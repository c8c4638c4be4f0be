"""The density of the data's actions learns means and deviations that depend on the observation."""

import pytest
import torch

from swarmdata.learn.networks.actor import BehaviorDensity, StackedActor
from swarmdata.learn.networks.setup import Setup
from tests.offline_algos.toys import SIZES, statistics


def made(floor: float = 0.01) -> BehaviorDensity:
    actor = StackedActor(Setup(SIZES, [0], statistics()), (32,), squash=True)
    return BehaviorDensity(actor, [0], floor=floor, learning_rate=1e-2, max_norm=None)


@pytest.mark.learns
def test_mean_and_deviation_are_learned_where_they_differ() -> None:
    density, generator = made(), torch.Generator().manual_seed(0)
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
    density = made()
    o, a = torch.randn(1, 16, 2, 3), torch.rand(1, 16, 2, 2) - 0.5
    mean, deviation = density.moments(o, a)
    normal = torch.distributions.Normal(mean, deviation)
    log_probs = normal.log_prob(a)  # type: ignore[no-untyped-call]
    expected = -(log_probs + 0.5 * torch.log(torch.tensor(2 * torch.pi))).sum(3).mean()
    torch.testing.assert_close(density.gradient(o, a)[0], expected)


def test_the_mean_descends_the_squared_error_whatever_the_deviation() -> None:
    """The head's gradient of the mean: that of 1/2 |m - a|^2, the mean over rows and robots."""
    density = made()
    o, a = torch.randn(1, 16, 2, 3), torch.rand(1, 16, 2, 2) - 0.5
    mean, _ = density.moments(o, a)
    density.gradient(o, a)
    bias = density.network.gradient[0, -4:-2]  # of the two means before tanh
    expected = ((mean - a) * (1 - mean.square())).mean((0, 1, 2))
    torch.testing.assert_close(bias, expected)


def test_deviations_have_a_floor() -> None:
    o, a = torch.randn(1, 16, 2, 3), torch.zeros(1, 16, 2, 2)
    assert made(floor=5.0).moments(o, a)[1].min() == 5.0
