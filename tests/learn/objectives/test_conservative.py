"""Conservative penalties: samples, their densities, and an estimate of each critic's own."""

import math

import pytest
import torch

from swarmdata.learn.networks.network_inputs import generators
from swarmdata.learn.objectives.conservative import (
    cql_gap,
    noisy_samples,
    soft_maximum,
    uniform_samples,
)


def test_uniform_samples_fill_the_range_and_know_their_density() -> None:
    noise = generators([0, 1], "cpu")
    samples = uniform_samples(noise, torch.zeros(2, 50, 3, 2), 40)
    assert samples.actions.shape == (2, 50, 40, 3, 2)
    assert samples.actions.abs().max() <= 1
    assert samples.actions.mean().item() == pytest.approx(0, abs=0.02)
    assert samples.actions.square().mean().item() == pytest.approx(1 / 3, abs=0.02)
    assert torch.equal(samples.log_density, torch.full((2, 50, 40), 6 * math.log(0.5)))
    assert not torch.equal(samples.actions[0], samples.actions[1])


def test_noisy_samples_have_the_log_density_of_their_noise() -> None:
    """Not the density itself, as in the published code of OMAR."""
    centers = torch.zeros(1, 4, 2, 2)
    samples = noisy_samples(generators([0], "cpu"), centers, 500, 0.2)
    normal = torch.distributions.Normal(0.0, 0.2)
    inside = (samples.actions.abs() < 1).all((3, 4))  # clipped ones hide their noise
    log_probs = normal.log_prob(samples.actions)  # type: ignore[no-untyped-call]
    expected = log_probs.sum((3, 4))
    torch.testing.assert_close(samples.log_density[inside], expected[inside], rtol=1e-4, atol=1e-4)
    assert samples.actions.std().item() == pytest.approx(0.2, abs=0.01)
    assert noisy_samples(generators([0], "cpu"), centers, 10, 1.0).actions.abs().max() == 1


def test_the_estimate_is_the_integral() -> None:
    """Q(b) = 3 b_1 on [-1, 1]^2: the integral of exp(Q / tau) is 2 tau / 3 (e^c - e^-c)."""
    template, tau = torch.zeros(1, 1, 1, 2), 0.5
    expected = tau * math.log(2 * tau / 3 * (math.exp(6) - math.exp(-6)))
    even = uniform_samples(generators([0], "cpu"), template, 100_000)
    near = noisy_samples(generators([1], "cpu"), template + 0.5, 100_000, 5.0)
    kept = near.actions.abs().amax((3, 4)) < 1  # the unclipped ones, weighted by their part
    for samples in (even, type(near)(near.actions, near.log_density.where(kept, torch.inf))):
        values = 3 * samples.actions[None, ..., 0, 0]
        got = soft_maximum(values, samples.log_density, tau)
        assert got.item() == pytest.approx(expected, abs=0.02)


def test_a_gap_beyond_its_limit_is_cut_row_by_row() -> None:
    q = torch.tensor([[[1.0, 5.0]]])  # [K, J, B]; samples are worth 0, of density 1
    gap = cql_gap(torch.zeros(1, 2, 1), torch.zeros(1, 1, 2, 1), q, 1.0, 2.0)
    torch.testing.assert_close(gap, torch.tensor([[(-1.0 - 2.0) / 2]]))
