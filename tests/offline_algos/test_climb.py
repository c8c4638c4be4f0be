"""How far students climb: measured scales, the bounded pull, and what a copy survives."""

import pytest
import torch
from torch import Tensor

from swarmdata.learn.objectives.losses import anchored_loss
from swarmdata.offline_algos.mac_flow import Climb

K, B, N, M, A = 2, 200, 3, 4, 2
SLOPES = torch.tensor([0.5, 20.0])  # of the values of each seed
SPREADS = torch.tensor([0.3, 0.05])  # deviations of the actions of each seed


def climb_of(inverse_temperature: float = 2.0, slope_limit: float = 1.5) -> Climb:
    return Climb(K, inverse_temperature=inverse_temperature, slope_limit=slope_limit, device="cpu")


def measured(inverse_temperature: float = 2.0, slope_limit: float = 1.5) -> Climb:
    """Of values that rise by SLOPES along the first action."""
    climb, generator = climb_of(inverse_temperature, slope_limit), torch.Generator().manual_seed(0)
    mean = 0.1 * torch.randn((K, B, N, 1, A), generator=generator)
    away = SPREADS.view(K, 1, 1, 1, 1) * torch.randn((K, B, N, M, A), generator=generator)
    noise = torch.randn((K, B, N, M, A), generator=generator)
    climb.measure(mean + away, noise, lambda drawn: SLOPES.view(K, 1, 1, 1) * drawn[..., 0])
    return climb


def pull(climb: Climb, slopes: Tensor) -> Tensor:
    """What the loss adds to one robot's action against its gradient, times B N, [K, A]."""
    pi = torch.zeros(K, B, N, A, requires_grad=True)
    loss = climb.loss(pi, slopes.view(K, 1, 1) * pi[..., 0])
    (gradient,) = torch.autograd.grad(loss.sum(), pi)
    assert torch.allclose(gradient, gradient[:, :1, :1].expand_as(gradient))
    return -gradient[:, 0, 0] * B * N


def test_scales_are_those_of_the_samples_and_the_values() -> None:
    climb = measured()
    torch.testing.assert_close(climb.slope, SLOPES, rtol=0.1, atol=0)
    torch.testing.assert_close(climb.weight, 2 * 2.0 * SPREADS**2 / (A * SLOPES), rtol=0.1, atol=0)


@pytest.mark.parametrize("steeper", [1.0, 100.0])
def test_a_pull_is_bounded(steeper: float) -> None:
    climb = measured(slope_limit=1.5)
    length = (steeper * SLOPES).clamp(max=1.5 * climb.slope)
    expected = torch.stack([climb.weight * length, torch.zeros(K)], 1)
    torch.testing.assert_close(pull(climb, steeper * SLOPES), expected)


def test_values_are_asked_for_actions_about_the_mean_within_the_bounds() -> None:
    climb, noise = climb_of(), torch.randn(K, B, N, M, A)
    away = torch.tensor([0.5, -0.5, 0.5, -0.5])[:, None]  # of variance 1 / 3
    asked: list[Tensor] = []

    def value_of(drawn: Tensor) -> Tensor:
        asked.append(drawn)
        return drawn.sum(4)

    climb.measure((0.2 + away).expand(K, B, N, M, A), noise, value_of)
    torch.testing.assert_close(asked[0], (0.2 + noise / 3**0.5).clamp(-1, 1))


def test_without_a_temperature_nothing_climbs() -> None:
    assert pull(measured(inverse_temperature=0.0), SLOPES).abs().max() == 0


def test_beside_the_copy_it_is_the_anchored_loss() -> None:
    """Both gradients are the same, up to the factor that the docstring tells."""
    climb = measured(slope_limit=1.5)
    variance = climb.weight * A * climb.slope / (2 * 2.0)
    copied, pi = 0.3 * torch.randn(K, B, N, A), torch.zeros(K, B, N, A, requires_grad=True)

    def values() -> Tensor:  # each loss takes their graph down
        return (3 * pi).sin().sum(3) * SLOPES.view(K, 1, 1)

    total = (pi - copied).square().mean((1, 2, 3)) + climb.loss(pi, values())
    (found,) = torch.autograd.grad(total.sum(), pi)
    deviation = variance.sqrt().view(K, 1, 1, 1).expand_as(pi)
    eta, steepest = 2.0 / climb.slope, 1.5 * climb.slope
    loss = anchored_loss(pi, values(), copied, deviation, eta, steepest)
    (expected,) = torch.autograd.grad((loss * eta * 2 * variance / A).sum(), pi)
    torch.testing.assert_close(found, expected)


def test_data_that_are_all_alike_hold_still() -> None:
    climb, same = climb_of(), torch.zeros(K, B, N, M, A)
    climb.measure(same, torch.randn(K, B, N, M, A), lambda drawn: drawn.sum(4))
    assert climb.is_measured
    assert pull(climb, torch.full((K,), 1e3)).abs().max() < 1e-5


def test_robots_that_left_do_not_count() -> None:
    """Scales are those of the other robots alone."""
    draw = torch.Generator().manual_seed(0)
    samples, noise = torch.randn(2, K, 6, 3, 5, 2, generator=draw)
    there, few = torch.ones(K, 6, 3, dtype=torch.bool), torch.zeros(K, 6, 3, dtype=torch.bool)
    few[:, :, :2] = True
    found, alone = climb_of(), climb_of()
    found.measure(samples, noise, lambda drawn: drawn.sum(4), few)
    alone.measure(samples[:, :, :2], noise[:, :, :2], lambda drawn: drawn.sum(4), there[:, :, :2])
    torch.testing.assert_close(found.state_dict(), alone.state_dict())
