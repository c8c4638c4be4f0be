"""Statistics of scores against values worked out by hand or by brute force."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import SchemaError
from swarmdata.rollouts import score_statistics
from swarmdata.rollouts.score_statistics import bootstrap
from swarmdata.types import Double


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        ([[7.0]], 7.0),
        ([[1.0], [2.0], [9.0]], 4.0),  # floor(3 / 4) = 0 are dropped
        ([[100.0], [2.0], [3.0], [-50.0]], 2.5),
        ([[5.0], [1.0], [4.0], [2.0], [90.0]], (2 + 4 + 5) / 3),
        ([[8.0, 1.0, 2.0, 7.0], [3.0, 6.0, 5.0, 4.0]], 4.5),
    ],
)
def test_iqm_by_hand(scores: list[list[float]], expected: float) -> None:
    assert score_statistics.iqm(np.array(scores)) == pytest.approx(expected)


TABLES = arrays(
    np.float64,
    st.tuples(st.integers(1, 9), st.integers(1, 4)),
    elements=st.floats(-1e3, 1e3),
)


@given(TABLES)
@settings(deadline=None)
def test_aggregates_equal_their_definitions(table: Double) -> None:
    flat = sorted(table.ravel().tolist())
    cut = len(flat) // 4
    middle = flat[cut : len(flat) - cut]
    assert score_statistics.iqm(table) == pytest.approx(sum(middle) / len(middle), abs=1e-9)
    assert score_statistics.mean(table) == pytest.approx(sum(flat) / len(flat), abs=1e-9)
    gap = sum(100.0 - min(v, 100.0) for v in flat) / len(flat)
    assert score_statistics.optimality_gap(table) == pytest.approx(gap, abs=1e-9)
    stacked = np.stack([table, table + 1.0])
    for aggregate in (score_statistics.iqm, score_statistics.mean, score_statistics.optimality_gap):
        assert aggregate(stacked).shape == (2,)
        assert aggregate(stacked)[0] == pytest.approx(float(aggregate(table)), abs=1e-9)


def test_probability_of_improvement_by_brute_force() -> None:
    x = np.array([[1.0, 5.0], [2.0, 5.0], [3.0, 0.0]])
    y = np.array([[2.0, 5.0], [0.0, 1.0]])
    wins = [
        1.0 if a > b else 0.5 if a == b else 0.0
        for task in range(2)
        for a, b in itertools.product(x[:, task], y[:, task])
    ]
    assert score_statistics.probability_of_improvement(x, y) == pytest.approx(np.mean(wins))
    assert score_statistics.probability_of_improvement(x, x) == 0.5


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
            score_statistics.iqm, table, generator=np.random.default_rng(1), n_resamples=501
        )

    whole = run()
    monkeypatch.setattr(score_statistics, "MAX_RESAMPLED_SCORES", 100)
    assert run() == whole


def test_bootstrap_of_two_tables_resamples_both() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.normal(1.0, 1.0, (10, 1)), rng.normal(0.0, 1.0, (7, 1))
    found = bootstrap(score_statistics.probability_of_improvement, x, y, generator=rng)
    assert found.low < found.value < found.high <= 1.0
    assert found.value > 0.5


def test_bootstrap_covers_the_true_mean() -> None:
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(200):
        low, high = bootstrap(
            score_statistics.mean, rng.normal(size=(60, 1)), generator=rng, n_resamples=400
        )[1:]
        hits += low <= 0.0 <= high
    assert 180 <= hits <= 199  # 95 % of 200, with room for five standard deviations below


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
