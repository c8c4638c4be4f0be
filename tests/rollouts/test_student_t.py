"""Quantiles of Student's t are those of tables, and of the normal distribution in the limit."""

import math
from statistics import NormalDist

import pytest

from swarmdata.rollouts.score_intervals import t_quantile

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
