"""Estimates of results: as in tables, paired, and refused where nothing can be compared."""

from dataclasses import replace

import numpy as np
import pytest

import swarmdata
from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.rollouts.score_intervals import count_interval, mean_interval, rate_interval
from swarmdata.rollouts.score_statistics import wilson_interval
from swarmdata.types import Double, EvalResult

RANDOM = np.random.default_rng(3)
HARD = RANDOM.normal(size=40)  # what an episode does to every policy


def result(policy: str, shift: float = 0.0, **metrics: Double) -> EvalResult:
    known: dict[str, Double] = {
        "return": HARD + shift + 0.01 * RANDOM.normal(size=40),
        "success": (HARD > 0).astype(float),
        "robot_collisions": np.zeros(40),
    }
    return EvalResult(
        policy, "coop_nav", "a" * 64, np.arange(40, dtype=np.uint64), {**known, **metrics}
    )


def test_each_kind_of_metric_has_the_interval_of_tables() -> None:
    runs = [result("a"), result("a", 0.5)]
    values = {name: np.stack([run.metrics[name] for run in runs]) for name in runs[0].metrics}
    assert swarmdata.estimate(runs) == mean_interval(values["return"])
    assert swarmdata.estimate(runs, "success") == rate_interval(values["success"])
    collisions = swarmdata.estimate(runs, "robot_collisions")
    assert collisions == count_interval(values["robot_collisions"])
    assert collisions.high > 0
    assert swarmdata.estimate(runs[0]) == swarmdata.estimate(runs[:1])


def test_a_share_that_is_called_a_success_is_a_mean() -> None:
    shares = result("a", grasp_success=np.full(40, 0.6))
    assert swarmdata.estimate(shares, "grasp_success").value == pytest.approx(0.6)


def test_differences_are_paired_by_episode() -> None:
    better, worse = result("b", 0.1), result("w")
    alone = swarmdata.estimate(better)
    found = swarmdata.estimate(better, minus=worse)
    assert found.value == pytest.approx(0.1, abs=0.01)
    assert found.low > 0.08
    assert alone.high - alone.low > 0.3


def solving(n: int) -> EvalResult:
    """A policy that solves the first n episodes."""
    return result("a", success=(np.arange(40) < n).astype(float))


def test_a_failure_more_does_not_raise_the_lower_end() -> None:
    never, once = ([solving(40 - k)] + [solving(40)] * 4 for k in (0, 1))
    assert swarmdata.estimate(never, "success") == wilson_interval(40, 40)
    assert swarmdata.estimate(once, "success").low < swarmdata.estimate(never, "success").low


def test_a_difference_of_certain_outcomes_has_a_width() -> None:
    found = swarmdata.estimate(solving(40), "success", minus=solving(0))
    half = 1 - wilson_interval(40, 40).low
    assert (found.value, found.high) == (1.0, 1.0)
    assert found.low == pytest.approx(1 - np.hypot(half, half))
    same = swarmdata.estimate(solving(40), "success", minus=solving(40))
    assert same.value == 0.0
    assert same.low == pytest.approx(-half)
    assert same.high == pytest.approx(half)


def test_what_cannot_be_estimated_is_refused() -> None:
    own, other = result("a"), replace(result("b"), spec_hash="b" * 64)
    fewer = replace(own, seeds=own.seeds + np.uint64(1))
    with pytest.raises(UnknownNameError, match="Did you mean 'return'"):
        swarmdata.estimate(own, "returns")
    for pair in (other, fewer):
        with pytest.raises(SchemaError, match="different"):
            swarmdata.estimate([own, pair])
        with pytest.raises(SchemaError, match="different"):
            swarmdata.estimate(own, minus=pair)
    undefined = result("a", time_to_goal=np.where(HARD > 0, 1.0, np.nan))
    with pytest.raises(SchemaError, match=r"time_to_goal is undefined in \d+ of 40 episodes"):
        swarmdata.estimate(undefined, "time_to_goal")
    with pytest.raises(SchemaError, match="there are no results"):
        swarmdata.estimate([])
    with pytest.raises(SchemaError, match="expected what swarmdata"):
        swarmdata.estimate(["runs/bc"])  # type: ignore[list-item]
