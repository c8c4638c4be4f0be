"""Intervals have the right parts of the variance, and are defined for every table."""

import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_intervals import (
    AT_LEAST_ZERO,
    SHARE,
    TARGET_OF_ONE,
    TARGET_OF_SEVERAL,
    combination_interval,
    count_interval,
    difference_interval,
    mean_interval,
    rate_interval,
    seed_interval,
    t_quantile,
    target_of,
)
from swarmdata.rollouts.score_statistics import Estimate, wilson_interval
from swarmdata.types import Double

RNG = np.random.default_rng(0)
BY_SEED, BY_EPISODE = RNG.normal(size=(4, 1)), RNG.normal(size=(1, 60))


def half(found: Estimate) -> float:
    assert found.high - found.value == pytest.approx(found.value - found.low)
    return found.high - found.value


def test_seeds_alone_give_students_interval() -> None:
    found = mean_interval(np.repeat(BY_SEED, 60, axis=1))
    assert half(found) == pytest.approx(t_quantile(0.975, 3) * BY_SEED.std(ddof=1) / 2)
    assert found.value == pytest.approx(BY_SEED.mean())


def test_episodes_that_all_seeds_share_give_students_interval_over_episodes() -> None:
    expected = t_quantile(0.975, 59) * BY_EPISODE.std(ddof=1) / math.sqrt(60)
    assert half(mean_interval(np.repeat(BY_EPISODE, 4, axis=0))) == pytest.approx(expected)
    assert half(mean_interval(BY_EPISODE)) == pytest.approx(expected)  # of one seed


def test_both_parts_add_with_satterthwaites_degrees_of_freedom() -> None:
    x = BY_SEED + BY_EPISODE
    s2, c = BY_SEED.var(ddof=1) / 4, BY_EPISODE.var(ddof=1) / 60
    df = (s2 + c) ** 2 / (s2**2 / 3 + c**2 / 59)
    assert half(mean_interval(x)) == pytest.approx(t_quantile(0.975, df) * math.sqrt(s2 + c))


def covariances_of(x: Double) -> float:
    """Mean covariance of two different seeds, from all pairs."""
    found = np.cov(x)
    return float(found[~np.eye(len(x), dtype=bool)].mean())


def test_what_seeds_share_is_the_mean_of_all_covariances() -> None:
    x, y = RNG.normal(size=(4, 60)) + BY_EPISODE, RNG.normal(size=(3, 60)) + 2 * BY_EPISODE
    for tables, parts in (
        ([x], covariances_of(x)),
        ([x, y], covariances_of(x) + covariances_of(y) - 2 * np.cov(x.mean(0), y.mean(0))[0, 1]),
    ):
        seeds = [each.mean(axis=1).var(ddof=1) / len(each) for each in tables]
        total = [*seeds, max(parts, 0.0) / 60]
        dfs = [*(len(each) - 1 for each in tables), 59]
        df = sum(total) ** 2 / sum(v * v / d for v, d in zip(total, dfs, strict=True))
        found = combination_interval(tables, [1.0, -1.0][: len(tables)])
        assert half(found) == pytest.approx(t_quantile(0.975, df) * math.sqrt(sum(total)))


def test_a_difference_loses_what_both_share() -> None:
    hard = 100 * BY_EPISODE
    x, y = hard + 2.0 + BY_SEED, hard + 1.0 + BY_SEED[::-1]
    found = difference_interval(x, y)
    assert found.value == pytest.approx(1.0)
    error = math.sqrt(2 * BY_SEED.var(ddof=1) / 4)
    assert half(found) == pytest.approx(t_quantile(0.975, 6) * error, rel=1e-6)
    assert half(found) < 0.2 * half(mean_interval(x))
    swapped = difference_interval(y, x)
    assert swapped == pytest.approx((-found.value, -found.high, -found.low))


def test_one_seed_has_the_interval_of_the_measured_policy() -> None:
    x, y = RNG.normal(size=(1, 60)), RNG.normal(size=(5, 60))
    gaps = x[0] - y.mean(axis=0)
    expected = t_quantile(0.975, 59) * gaps.std(ddof=1) / math.sqrt(60)
    assert half(difference_interval(x, y)) == pytest.approx(expected)
    assert target_of([1]) == TARGET_OF_ONE
    assert target_of([5, 3]) == TARGET_OF_SEVERAL
    assert target_of([5, 1]) == f"{TARGET_OF_SEVERAL}; of a single seed, {TARGET_OF_ONE}"


def test_degenerate_tables() -> None:
    assert mean_interval(np.full((3, 5), 7.0)) == (7.0, 7.0, 7.0)
    for table in (np.ones((1, 1)), np.array([[1.0], [3.0]])):  # of one episode
        found = mean_interval(table)
        assert found.value == table.mean()
        assert math.isnan(found.low)
        assert math.isnan(found.high)
    opposed = np.array([[1.0, -1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0]])
    assert mean_interval(opposed) == (0.0, 0.0, 0.0)  # a negative covariance counts as none


@pytest.mark.parametrize(
    "tables",
    [
        [np.array([[1.0, math.nan]])],
        [np.array([[1.0, math.inf]])],
        [np.zeros(3)],
        [np.zeros((0, 3))],
        [np.zeros((2, 0))],
        [np.zeros((2, 3)), np.zeros((2, 4))],
    ],
)
def test_other_tables_are_refused(tables: list[Double]) -> None:
    with pytest.raises(SchemaError, match=r"expected finite \[seeds, episodes\] with the same"):
        combination_interval(tables, [1.0] * len(tables))


def test_rates_stay_between_none_and_all() -> None:
    rare = np.zeros((3, 40))
    rare[0, 0] = rare[1, 1] = 1.0
    found = rate_interval(rare)
    assert found.low == 0.0
    assert found.value == pytest.approx(2 / 120)
    assert rate_interval(1.0 - rare).high == 1.0
    assert rate_interval(rare[:1]) == wilson_interval(1, 40)
    assert rate_interval(np.ones((3, 40))) == wilson_interval(40, 40)
    assert rate_interval(np.zeros((3, 40))) == wilson_interval(0, 40)
    assert rate_interval(np.eye(3, 40)) == wilson_interval(1, 40), "seeds agree on the rate"
    assert rate_interval((RNG.random((3, 40)) < 0.5).astype(np.float64)).low > 0.0


def test_no_event_does_not_mean_that_there_never_is_one() -> None:
    """Of the highest mean that the interval contains, the chance of no event is 2.5 %."""
    for n_seeds in (1, 5):
        value, low, high = count_interval(np.zeros((n_seeds, 60)))
        assert (value, low) == (0.0, 0.0)
        assert math.exp(-60 * high) == pytest.approx(0.025)
    assert math.isnan(count_interval(np.zeros((5, 1))).high)
    counts = RNG.poisson(0.5, (5, 60)).astype(np.float64)
    assert count_interval(counts) == mean_interval(counts, bounds=AT_LEAST_ZERO)


def test_curves_have_intervals_of_seeds() -> None:
    means = np.array([1.0, 2.0, 6.0])
    found = seed_interval(means)
    assert half(found) == pytest.approx(4.3026527 * means.std(ddof=1) / math.sqrt(3))
    lone = seed_interval(means[:1])
    assert lone.value == 1.0
    assert math.isnan(lone.low)


def test_intervals_end_at_the_bounds_of_the_quantity() -> None:
    counts = np.zeros((5, 40))
    counts[0] = 3.0  # one training seed that collides: its interval would begin below 0
    whole, cut = mean_interval(counts), mean_interval(counts, bounds=AT_LEAST_ZERO)
    assert whole.low < 0.0
    assert cut == (whole.value, 0.0, whole.high)
    assert mean_interval(counts + 10.0, bounds=AT_LEAST_ZERO) == mean_interval(counts + 10.0)
    assert mean_interval(counts, bounds=(0.0, 3.0)).high == min(whole.high, 3.0)
    assert math.isnan(mean_interval(counts[:, :1], bounds=AT_LEAST_ZERO).low)  # still none
    shares = np.array([0.0, 0.0, 1.0])
    assert seed_interval(shares).low < 0.0
    assert seed_interval(shares, bounds=SHARE)[1:] == (0.0, 1.0)
    assert math.isnan(seed_interval(shares[:1], bounds=SHARE).high)


TABLES = arrays(
    np.float64,
    st.tuples(st.integers(1, 5), st.integers(2, 6)),
    elements=st.floats(-1e3, 1e3, width=32),
)


@given(TABLES, st.floats(-10, 10), st.floats(0.1, 10))
@settings(deadline=None)
def test_units_and_origins_do_not_matter(table: Double, shift: float, factor: float) -> None:
    found = mean_interval(table)
    assert found.low <= found.value <= found.high
    moved = mean_interval(factor * table + shift)
    assert moved == pytest.approx([factor * each + shift for each in found], rel=1e-4, abs=1e-2)
    assert difference_interval(table, table).value == 0.0


TABLE = {1: 12.7062047, 2: 4.3026527, 3: 3.1824463, 4: 2.7764451, 9: 2.2621572, 30: 2.0422725,
         120: 1.9799304}  # fmt: skip


@pytest.mark.parametrize(("df", "quantile"), TABLE.items())
def test_quantiles_are_those_of_tables(df: int, quantile: float) -> None:
    assert t_quantile(0.975, df) == pytest.approx(quantile, rel=1e-6)


def test_closed_forms_and_limits() -> None:
    for p in (0.6, 0.9, 0.975):
        assert t_quantile(p, 1) == pytest.approx(math.tan(math.pi * (p - 0.5)))
        x = 2.0 * p - 1.0
        assert t_quantile(p, 2) == pytest.approx(x * math.sqrt(2.0 / (1.0 - x * x)))
        normal = NormalDist().inv_cdf(p)
        assert t_quantile(p, math.inf) == normal
        assert t_quantile(p, 1e6) == pytest.approx(normal, rel=1e-5)
    assert t_quantile(0.5, 3) == 0.0


@pytest.mark.slow
def test_real_degrees_of_freedom_lie_between_whole_ones() -> None:
    found = [t_quantile(0.975, 1.0 + 0.1 * k) for k in range(200)]
    assert found == sorted(found, reverse=True)
    stats = pytest.importorskip("scipy.stats")
    for df in (1.1, 1.7, 2.5, 7.3, 60.5):
        assert t_quantile(0.975, df) == pytest.approx(stats.t.ppf(0.975, df), rel=2e-5)


@pytest.mark.parametrize(("p", "df"), [(0.4, 3), (1.0, 3), (0.9, 0.5), (math.nan, 3)])
def test_other_arguments_are_refused(p: float, df: float) -> None:
    with pytest.raises(ValueError, match="at least one degree of freedom"):
        t_quantile(p, df)
