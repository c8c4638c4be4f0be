"""Estimates agree with what is known of Gaussians and boxes, and do not depend on coordinates."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.analysis.entropy import (
    EULER_GAMMA,
    NEIGHBOR_RANK,
    correlation,
    digamma,
    dither,
    knn_entropy,
    mutual_information,
)
from swarmdata.errors import SchemaError
from swarmdata.types import Double

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.tuples(st.integers(8, 120), st.integers(1, 4))


def gaussian(seed: int, n: int, d: int) -> Double:
    return np.random.default_rng(seed).normal(size=(n, d))


def naive_distances(points: Double) -> Double:
    """To the neighbor of each point that counts."""
    gaps = np.abs(points[:, None] - points[None]).max(axis=-1)
    return np.sort(gaps, axis=1)[:, NEIGHBOR_RANK]  # the first is the point itself


@pytest.mark.parametrize("d", [1, 2, 4])
def test_entropy_of_a_gaussian(d: int) -> None:
    points = gaussian(0, 4000, d) * np.arange(1, d + 1)
    exact = d / 2 * math.log(2 * math.pi * math.e) + math.log(math.factorial(d))
    assert knn_entropy(points) == pytest.approx(exact, abs=0.08)


def test_bounds_correct_what_cubes_reach_outside() -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 8))
    exact = 8 * math.log(2)
    assert knn_entropy(points) > exact + 1.0
    assert knn_entropy(points, bounds=(-1.0, 1.0)) == pytest.approx(exact, abs=0.25)
    far = gaussian(1, 2000, 2)
    assert knn_entropy(far, bounds=(-50.0, 50.0)) == pytest.approx(knn_entropy(far))
    with pytest.raises(SchemaError, match="expected values from 0 to 1"):
        knn_entropy(points, bounds=(0.0, 1.0))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_information_of_correlated_gaussians(rho: float) -> None:
    z = gaussian(2, 2000, 2)
    x, y = z[:, :1], rho * z[:, :1] + math.sqrt(1 - rho * rho) * z[:, 1:]
    assert mutual_information(x, y) == pytest.approx(-0.5 * math.log(1 - rho * rho), abs=0.05)
    assert correlation(x, y) == pytest.approx(rho, abs=0.05)


@given(SEEDS, SIZES)
def test_entropy_is_the_formula_on_naive_distances(seed: int, size: tuple[int, int]) -> None:
    n, d = size
    points = gaussian(seed, n, d)
    scales = points.std(axis=0)
    logs = np.log(2 * naive_distances(points / scales)).mean()
    psi = digamma(n)
    expected = psi[n] - psi[NEIGHBOR_RANK] + d * logs + np.log(scales).sum()
    assert knn_entropy(points) == pytest.approx(expected, abs=1e-9)


@given(SEEDS, SIZES)
def test_information_is_the_formula_on_naive_counts(seed: int, size: tuple[int, int]) -> None:
    n, d = size
    x, y = gaussian(seed, n, d), gaussian(seed + 1, n, d)
    a, b = x / x.std(axis=0), y / y.std(axis=0)
    reach = naive_distances(np.concatenate([a, b], axis=1))[:, None]
    counts = [(np.abs(z[:, None] - z[None]).max(axis=-1) < reach).sum(axis=1) - 1 for z in (a, b)]
    psi = digamma(n)
    marginal = psi[counts[0] + 1] + psi[counts[1] + 1]
    expected = psi[NEIGHBOR_RANK] + psi[n] - marginal.mean()
    assert mutual_information(x, y) == pytest.approx(expected, abs=1e-9)


@given(SEEDS, SIZES, st.floats(-50, 50), st.floats(0.01, 100))
def test_order_place_and_scale(
    seed: int, size: tuple[int, int], shift: float, factor: float
) -> None:
    n, d = size
    x, y = gaussian(seed, n, d), gaussian(seed + 1, n, 2)
    order = np.random.default_rng(seed).permutation(n)
    entropy, information = knn_entropy(x), mutual_information(x, y)
    assert knn_entropy(x[order]) == pytest.approx(entropy, abs=1e-9)
    assert mutual_information(x[order], y[order]) == pytest.approx(information, abs=1e-9)
    assert mutual_information(y, x) == pytest.approx(information, abs=1e-9)
    assert knn_entropy(x + shift) == pytest.approx(entropy, abs=1e-6)
    first = np.ones(d)
    first[0] = factor  # one coordinate in another unit
    assert knn_entropy(x * first) == pytest.approx(entropy + math.log(factor), abs=1e-6)


@given(SEEDS, st.floats(1e-6, 10))
def test_dither_is_seeded_and_small_and_gives_copies_a_density(
    seed: int, resolution: float
) -> None:
    copies = np.repeat(gaussian(4, 50, 2), 8, axis=0)
    assert math.isfinite(knn_entropy(dither(copies, 0.01, seed)))
    points = gaussian(seed, 40, 3)
    moved = dither(points, resolution, seed)
    assert (np.abs(moved - points) <= resolution / 2 * (1 + 1e-9)).all()
    assert (moved == dither(points, resolution, seed)).all()
    assert (moved != dither(points, resolution, seed + 1)).any()


def test_digamma_is_that_of_the_tables() -> None:
    psi = digamma(10)
    assert psi[1:4] == pytest.approx([-EULER_GAMMA, 1 - EULER_GAMMA, 1.5 - EULER_GAMMA])
    assert psi[10] == pytest.approx(2.2517525890667212)
    assert digamma(1).shape == (2,)


def test_correlation_without_variation_is_none() -> None:
    x = np.stack([np.arange(9.0), np.zeros(9)], axis=1)
    assert correlation(x, -x) == pytest.approx(0.5)
