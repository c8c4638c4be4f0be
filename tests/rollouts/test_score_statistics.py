"""Statistics of scores against values worked out by hand or by brute force."""

import itertools
import math

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.rollouts import score_statistics
from swarmdata.rollouts.score_statistics import bootstrap
from swarmdata.types import Double


def exact_bootstrap(table: Double) -> Double:
    """The mean over every equally likely stratified resample."""
    draws = list(itertools.product(range(len(table)), repeat=len(table)))
    per_task = [[column[list(rows)].mean() for rows in draws] for column in table.T]
    return np.array([np.mean(combination) for combination in itertools.product(*per_task)])


def test_bootstrap_agrees_with_every_possible_resample() -> None:
    table = np.array([[0.0, 10.0], [1.3, 14.0], [4.1, 11.0]])
    exact = exact_bootstrap(table)
    assert len(exact) == 27**2
    found = bootstrap(
        score_statistics.mean, table, generator=np.random.default_rng(0), n_resamples=40_000
    )
    assert found.value == pytest.approx(table.mean())
    np.testing.assert_allclose(found[1:], np.quantile(exact, [0.025, 0.975]), atol=0.06)


def test_bootstrap_never_mixes_tasks_and_draws_them_independently() -> None:
    table = np.array([[0.0, 100.0], [1.0, 101.0]])
    sums: list[Double] = []

    def keep(resampled: Double) -> Double:
        sums.append(resampled)
        return score_statistics.mean(resampled)

    bootstrap(keep, table, generator=np.random.default_rng(0), n_resamples=400)
    drawn = sums[0]
    assert drawn.shape == (400, 2, 2)
    assert set(np.unique(drawn[..., 0])) == {0.0, 1.0}
    assert set(np.unique(drawn[..., 1])) == {100.0, 101.0}
    independent = (drawn[..., 0] == drawn[..., 1] - 100.0).mean()
    assert 0.4 < independent < 0.6


def test_bootstrap_is_a_function_of_the_generator_and_of_no_chunking(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = np.random.default_rng(3).normal(size=(6, 3))

    def run() -> score_statistics.Estimate:
        return bootstrap(
            score_statistics.mean, table, generator=np.random.default_rng(1), n_resamples=501
        )

    whole = run()
    monkeypatch.setattr(score_statistics, "MAX_RESAMPLED_SCORES", 100)
    assert run() == whole


@pytest.mark.parametrize("table", [np.zeros((0, 1)), np.zeros(3), np.array([[np.nan]])])
def test_bootstrap_refuses_what_is_not_a_finite_table(table: Double) -> None:
    with pytest.raises(SchemaError, match=r"expected finite \[runs, tasks\]"):
        bootstrap(score_statistics.mean, table, generator=np.random.default_rng(0))


def test_wilson_interval_solves_its_equation() -> None:
    z = 1.959963984540054
    for k, n in [(0, 10), (1, 10), (500, 1000), (987, 1000), (1000, 1000)]:
        rate, low, high = score_statistics.wilson_interval(k, n)
        assert 0.0 <= low <= rate <= high <= 1.0
        for end in {low, high} - {0.0, 1.0}:
            assert abs(rate - end) == pytest.approx(z * math.sqrt(end * (1 - end) / n))
    # Brown, Cai and DasGupta 2001: for 0 successes the upper end is z^2 / (n + z^2)
    assert score_statistics.wilson_interval(0, 10).high == pytest.approx(z * z / (10 + z * z))


@pytest.mark.parametrize(("k", "n"), [(-1, 5), (6, 5), (0, 0)])
def test_wilson_interval_refuses_impossible_counts(k: int, n: int) -> None:
    with pytest.raises(SchemaError, match="expected 0 <= successes <= episodes"):
        score_statistics.wilson_interval(k, n)
