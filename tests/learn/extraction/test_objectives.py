"""Losses of extraction: where they are least, and what each robot contributes."""

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.extraction.objectives import (  # noqa: E402
    anchored_loss,
    bounded_gradient,
    tilted_loss,
    tilted_mean,
    weighted_loss,
)

ETA = torch.tensor([2.0])
UNBOUNDED = torch.tensor([float("inf")])


def test_the_anchored_loss_is_least_at_the_mode_of_the_tilted_density() -> None:
    """With Q = g a, the mode of N(m, s^2) exp(eta g a) is m + eta s^2 g."""
    mean, deviation = torch.tensor([[[[0.1, -0.2]]]]), torch.tensor([[[[0.2, 0.3]]]])
    slope = torch.tensor([0.5, -0.25])
    mode = mean + ETA * deviation.square() * slope

    def gradient(pi: Tensor) -> Tensor:
        pi = pi.clone().requires_grad_()
        loss = anchored_loss(pi, (pi * slope).sum(3), mean, deviation, ETA, UNBOUNDED)
        (result,) = torch.autograd.grad(loss.sum(), pi)
        return result

    torch.testing.assert_close(gradient(mode), torch.zeros_like(mode), atol=1e-6, rtol=0)
    assert gradient(mode + 0.1)[..., 0] > 0 > gradient(mode - 0.1)[..., 0]


@pytest.mark.parametrize("height", [0.1, 1.0, 30.0])
def test_a_steep_critic_cannot_pull_actions_further_than_its_bound(height: float) -> None:
    """However steep Q is, descent ends within eta s^2 times the bound of the density's mean."""
    mean, deviation = torch.tensor([[[[0.1, -0.2]]]]), torch.full((1, 1, 1, 2), 0.3)
    direction, steepest = torch.tensor([0.6, -0.8]), torch.tensor([0.5])
    pi = mean.clone().requires_grad_()
    for _ in range(200):
        loss = anchored_loss(pi, height * (pi * direction).sum(3), mean, deviation, ETA, steepest)
        (gradient,) = torch.autograd.grad(loss.sum(), pi)
        pi = (pi - 0.05 * gradient).detach().requires_grad_()
    expected = min(height, 0.5) * ETA * 0.3**2 * direction
    torch.testing.assert_close((pi.detach() - mean)[0, 0, 0], expected, atol=1e-4, rtol=0)


def test_flat_values_pull_nothing() -> None:
    pi = torch.zeros(1, 2, 1, 2, requires_grad=True)
    pulled = bounded_gradient((0.0 * pi).sum(3), pi, torch.tensor([1.0]))
    assert (pulled == 0).all()


def test_the_weighted_loss_prefers_better_actions_and_bounds_their_weight() -> None:
    pi = torch.zeros(1, 2, 1, 1, requires_grad=True)
    actions = torch.ones(1, 2, 1, 1)
    advantages = torch.tensor([[[1.0], [0.0]]])
    loss = weighted_loss(pi, actions, advantages, ETA, 100.0)
    (slope,) = torch.autograd.grad(loss.sum(), pi)
    assert slope[0, 0] / slope[0, 1] == pytest.approx(torch.e**2, rel=1e-5)
    bounded = weighted_loss(pi, actions, advantages, ETA, 3.0)
    (slope,) = torch.autograd.grad(bounded.sum(), pi)
    assert slope[0, 0] / slope[0, 1] == pytest.approx(3.0, rel=1e-5)


def test_the_tilted_mean_goes_from_the_mean_to_the_best_candidate() -> None:
    candidates = torch.tensor([-0.5, 0.0, 0.8])[None, None, None, :, None]
    values = torch.tensor([0.0, 1.0, 2.0])[None, None, None]
    torch.testing.assert_close(
        tilted_mean(candidates, values, torch.tensor([1e-6])).item(), 0.1, atol=1e-5, rtol=0
    )
    torch.testing.assert_close(tilted_mean(candidates, values, torch.tensor([99.0])).item(), 0.8)
    pi = torch.full((1, 1, 1, 1), 0.8)
    assert tilted_loss(pi, candidates, values, torch.tensor([99.0])).item() < 1e-10


def test_losses_are_means_over_robots() -> None:
    """A robot's loss counts as much in a large team as in a small one, relative to the others."""
    generator = torch.Generator().manual_seed(0)
    pi, mean, actions = (torch.randn(1, 5, 1, 2, generator=generator) for _ in range(3))
    pi.requires_grad_()
    values = torch.randn(1, 5, 1, generator=generator)
    deviation = torch.full_like(mean, 0.3)
    for n in (2, 8):
        many, center, width, taken = (
            t.expand(-1, -1, n, -1) for t in (pi, mean, deviation, actions)
        )
        worth = values.expand(-1, -1, n)
        alone = anchored_loss(pi, values * pi.sum(3), mean, deviation, ETA, UNBOUNDED)
        together = anchored_loss(many, worth * many.sum(3), center, width, ETA, UNBOUNDED)
        torch.testing.assert_close(together, alone)
        torch.testing.assert_close(
            weighted_loss(many, taken, worth, ETA, 9.0),
            weighted_loss(pi, actions, values, ETA, 9.0),
        )
