"""Aggregates are those of rliable and scipy, and intervals those of every possible resample."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.evaluation.results.aggregates import (
    aggregates,
    comparable_scores,
    improvements,
    mean_over_runs,
    pareto,
    pareto_front,
    performance_profile,
    profile_band,
    thresholds_of,
)
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.rollouts import score_statistics
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double
from tests.support.measured import EXPERT, MEDIUM, grid, result

TABLES = arrays(
    np.float64, st.tuples(st.integers(1, 7), st.integers(1, 4)), elements=st.integers(-50, 150)
)


def test_values_that_rliable_publishes() -> None:
    """`tests/rliable/metrics_test.py` of google-research/rliable."""
    x = np.array([[1.0, 2.0], [2.0, 2.0], [1.0, 1.0], [2.0, 1.0]])
    y = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    assert score_statistics.mean(x) == score_statistics.iqm(x) == 1.5
    assert score_statistics.mean(y) == score_statistics.iqm(y) == 2.0
    assert score_statistics.probability_of_improvement(x, y) == pytest.approx(1 / 3)


@given(TABLES, TABLES)
def test_aggregates_are_those_of_scipy(x: Double, y: Double) -> None:
    stats = pytest.importorskip("scipy.stats")
    assert score_statistics.iqm(x) == pytest.approx(stats.trim_mean(x, 0.25, axis=None))
    tasks = min(x.shape[1], y.shape[1])
    x, y = x[:, :tasks], y[:, :tasks]
    wins = [
        stats.mannwhitneyu(a, b, alternative="greater", method="asymptotic").statistic
        for a, b in zip(x.T, y.T, strict=True)
    ]
    expected = np.mean(wins) / (len(x) * len(y))
    assert score_statistics.probability_of_improvement(x, y) == pytest.approx(expected)
    both = improvements({"x": x, "y": y}, n_resamples=5)
    assert both["x", "y"].value + both["y", "x"].value == pytest.approx(1.0)


@given(TABLES)
def test_a_profile_is_the_share_of_runs_above(table: Double) -> None:
    thresholds = np.array([-60.0, -50.0, 0.0, 75.5, 150.0])
    profile = performance_profile(table, thresholds)
    flat = table.ravel().tolist()
    expected = [sum(value > t for value in flat) / len(flat) for t in thresholds]
    assert profile.tolist() == pytest.approx(expected)
    assert profile[0] == 1.0
    assert profile[-1] == 0.0
    assert (np.diff(profile) <= 0).all()
    grid_of = thresholds_of({"x": table}, 4001)
    width = grid_of[1] - grid_of[0]  # the area under the profile is the mean
    area = grid_of[0] + width * performance_profile(table, grid_of)[1:].sum()
    assert area == pytest.approx(table.mean(), abs=2 * width)


def test_the_band_is_that_of_every_possible_resample() -> None:
    table = np.array([[0.0, 10.0], [1.0, 14.0], [4.0, 11.0]])
    thresholds = np.array([0.5, 3.0, 10.5, 12.0])
    draws = list(itertools.product(range(3), repeat=3))
    exact = np.array(
        [
            performance_profile(np.stack([table[list(a), 0], table[list(b), 1]], 1), thresholds)
            for a, b in itertools.product(draws, draws)
        ]
    )
    band = profile_band(table, thresholds, n_resamples=20_000)
    np.testing.assert_allclose(band.value, performance_profile(table, thresholds))
    np.testing.assert_allclose(band.low, np.quantile(exact, 0.025, axis=0), atol=1e-9)
    np.testing.assert_allclose(band.high, np.quantile(exact, 0.975, axis=0), atol=1e-9)


def test_a_band_does_not_depend_on_its_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    table, thresholds = np.random.default_rng(0).random((5, 2)), np.linspace(0, 1, 7)
    whole = profile_band(table, thresholds, n_resamples=101)
    monkeypatch.setattr(score_statistics, "MAX_RESAMPLED_SCORES", 100)
    for one, other in zip(whole, profile_band(table, thresholds, n_resamples=101), strict=True):
        np.testing.assert_array_equal(one, other)


def test_only_what_was_measured_everywhere_is_aggregated() -> None:
    means = {"bc": {MEDIUM: 1.0, EXPERT: 5.0}, "omar": {MEDIUM: 2.0, EXPERT: 6.0}}
    short = [r for r in grid({"few": means["bc"]}) if r.provenance.dataset == MEDIUM or
             r.provenance.index == 0]  # fmt: skip
    lone = result("iql", "coop_nav-random-v1", spec=TaskSpec(horizon=9))
    found = comparable_scores(
        group_results([*grid(means), *grid({"vdn": {MEDIUM: 1.0}}), *short, lone])
    )
    assert found.datasets == (MEDIUM, EXPERT)
    assert list(found.tables) == ["bc", "omar"]
    assert found.tables["bc"].shape == (3, 2)
    assert found.left_out == {
        "coop_nav-random-v1": "no references were measured in its world",
        "few": "has between 1 and 3 runs on a dataset",
        "iql": f"not measured on {MEDIUM}, {EXPERT}",
        "vdn": f"not measured on {EXPERT}",
    }
    values = aggregates(found.tables, n_resamples=50)
    assert values["omar"].mean.value > values["bc"].mean.value
    for each in values.values():
        assert each.n_runs == 3
        assert each.iqm.low <= each.iqm.value <= each.iqm.high
        assert each.optimality_gap.value >= 100 - each.mean.value - 1e-9
    assert comparable_scores(group_results([lone])).tables == {}
    results = group_results([*grid(means), *grid({"vdn": {MEDIUM: 1.0}})])
    assert list(comparable_scores(results, [MEDIUM]).tables) == ["vdn", "bc", "omar"]
    with pytest.raises(UnknownNameError, match="unknown dataset with results"):
        comparable_scores(results, ["coop_nav-medum-v0"])
    with pytest.raises(SchemaError, match="no scores to draw a profile"):
        thresholds_of({})


def test_a_single_run_is_averaged_over_episodes() -> None:
    values = np.random.default_rng(1).normal(size=(1, 400))
    found = mean_over_runs(values)
    assert found.value == pytest.approx(values.mean())
    assert found.high - found.low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.1)
    several = mean_over_runs(np.array([[0.0, 2.0], [3.0, 5.0], [90.0, 92.0], [3.0, 3.0]]))
    assert several.value == pytest.approx((4.0 + 3.0) / 2)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=9))
def test_nothing_beats_the_front_and_something_beats_the_rest(
    points: list[tuple[int, int]],
) -> None:
    front = pareto_front(*zip(*points, strict=True))
    for (value, cost), is_best in zip(points, front, strict=True):
        beaten = [(v, c) for v, c in points if v >= value and c <= cost and (v, c) != (value, cost)]
        assert is_best == (not beaten)
    assert front.any()


def test_pareto_view_of_a_case() -> None:
    good, bold = result("good", mean=5.0), result("bold", mean=9.0)
    bad = result("bad", mean=-3.0)
    for each, hits in ((good, 0.0), (bold, 3.0), (bad, 3.0)):
        each.evaluation.metrics["robot_collisions"][:] = hits
        each.evaluation.metrics["obstacle_collisions"][:] = 1.0
    (case,) = group_results([good, bold, bad]).cases
    points = {point.label: point for point in pareto(case)}
    assert {label for label, point in points.items() if point.is_best} == {"good", "bold"}
    assert points["bold"].collisions.value == 4.0
    del bad.evaluation.metrics["robot_collisions"]  # type: ignore[attr-defined]
    with pytest.raises(UnknownNameError, match="robot_collisions"):
        pareto(case)
