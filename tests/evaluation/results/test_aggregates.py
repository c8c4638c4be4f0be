"""Aggregates follow their definitions, and differences are paired."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.aggregates import (
    collisions_and_returns,
    comparable_scores,
    differences,
    mean_over_datasets,
    optimality_gap,
    pareto_front,
    performance_profile,
    probability_of_improvement,
    thresholds_of,
)
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double
from tests.support.measured import EXPERT, MEDIUM, grid, result

TABLES = arrays(
    np.float64, st.tuples(st.integers(1, 7), st.integers(1, 4)), elements=st.integers(-50, 150)
)


@given(TABLES)
def test_the_gap_is_the_mean_shortfall(table: Double) -> None:
    expected = np.mean([max(0.0, 100.0 - value) for value in table.ravel()])
    assert optimality_gap(table) == pytest.approx(expected)


def test_ours_improve_as_often_as_one_of_our_runs_is_above_one_of_theirs() -> None:
    ours, theirs = np.array([[3.0, 0.0], [1.0, 5.0]]), np.array([[2.0, 5.0]])
    assert probability_of_improvement(ours, theirs) == (1 + 0 + 0 + 0.5) / 4
    assert probability_of_improvement(theirs, ours) == 1 - 1.5 / 4


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
    grid_of = thresholds_of({"x": table})
    width = grid_of[1] - grid_of[0]  # the area under the profile is the mean
    area = grid_of[0] + width * performance_profile(table, grid_of)[1:].sum()
    assert area == pytest.approx(table.mean(), abs=2 * width)


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
    assert found.tables["bc"].shape[:2] == (3, 2)
    assert found.left_out == {
        "coop_nav-random-v1": "no references were measured in its world",
        "few": "has between 1 and 3 runs on a dataset",
        "iql": f"not measured on {MEDIUM}, {EXPERT}",
        "vdn": f"not measured on {EXPERT}",
    }
    bc, omar = map(mean_over_datasets, found.tables.values())
    assert bc.low <= bc.value <= bc.high < omar.value
    assert comparable_scores(group_results([lone])).tables == {}


def test_differences_over_datasets_are_paired_by_episode() -> None:
    rng = np.random.default_rng(0)
    hard = 50 * rng.normal(size=(1, 2, 30))  # of each dataset and episode
    tables = {
        name: mean + hard + rng.normal(size=(k, 2, 1))
        for name, mean, k in (("bc", 1.0, 3), ("omar", 9.0, 4))
    }
    found = differences(tables)
    assert set(found) == {("bc", "omar"), ("omar", "bc")}
    gap = found["omar", "bc"]
    assert gap.value == pytest.approx(tables["omar"].mean() - tables["bc"].mean())
    assert 0.0 < gap.low < gap.value
    alone = mean_over_datasets(tables["omar"])
    assert gap.high - gap.low < 0.5 * (alone.high - alone.low)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=9))
def test_nothing_beats_the_front_and_something_beats_the_rest(
    points: list[tuple[int, int]],
) -> None:
    front = pareto_front(*zip(*points, strict=True))
    for (value, cost), is_best in zip(points, front, strict=True):
        beaten = [(v, c) for v, c in points if v >= value and c <= cost and (v, c) != (value, cost)]
        assert is_best == (not beaten)
    assert front.any()


def test_returns_and_collisions_of_a_case() -> None:
    good, bold = result("good", mean=5.0), result("bold", mean=9.0)
    bad = result("bad", mean=-3.0)
    for each, hits in ((good, 0.0), (bold, 3.0), (bad, 3.0)):
        each.evaluation.metrics["robot_collisions"][:] = hits
        each.evaluation.metrics["obstacle_collisions"][:] = 1.0
    (case,) = group_results([good, bold, bad]).cases
    points = collisions_and_returns(case)
    assert points["good"][1].value == pytest.approx(5.0, abs=1.0)
    assert points["bold"][0].value == 4.0
    del bad.evaluation.metrics["robot_collisions"]  # type: ignore[attr-defined]
    with pytest.raises(UnknownNameError, match="robot_collisions"):
        collisions_and_returns(case)
