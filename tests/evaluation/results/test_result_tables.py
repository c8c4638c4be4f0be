"""Tables show the right numbers with the right interval, and the data's own beside them."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from swarmdata.evaluation.results.aggregates import collisions_and_returns
from swarmdata.evaluation.results.estimate_table import Table
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import (
    QUANTITIES,
    aggregate_table,
    budget_table,
    case_table,
    difference_table,
    score_table,
)
from swarmdata.numerics.random import validation_seeds
from swarmdata.registry.published import published
from swarmdata.rollouts import score_statistics
from swarmdata.rollouts.score_intervals import TARGET_OF_SEVERAL, mean_interval, rate_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.model_choice import models_of, with_models
from tests.support.measured import COOP_NAV, EXPERT, MEANS, MEDIUM, foreign, grid, result


def cells(table: Table, label: str) -> dict[str, Estimate]:
    keys = [column.key for column in table.columns]
    (row,) = (row for row in table.rows if row.label == label)
    return dict(zip(keys, row.estimates, strict=True))


def test_one_run_is_averaged_over_episodes() -> None:
    made = result(n=40)
    (case,) = group_results([made]).cases
    row = cells(case_table(case), "bc")
    assert list(row)[:2] == ["score", "return"]
    returns = made.evaluation.metrics["return"]
    assert row["return"].value == pytest.approx(returns.mean())
    assert row["score"].value == pytest.approx(case.scores("bc").mean())
    standard_error = returns.std() / math.sqrt(40)
    assert row["return"].high - returns.mean() == pytest.approx(1.96 * standard_error, rel=0.15)
    assert row["success"] == score_statistics.wilson_interval(30, 40)
    assert row["clean_success"] == score_statistics.wilson_interval(20, 40)
    assert row["time_to_goal"].value == pytest.approx((30 * 6.0 + 10 * 16.0) / 40)


def test_several_runs_give_the_mean_and_what_its_interval_is_for() -> None:
    runs = [result(index=k, mean=m) for k, m in enumerate((0.0, 1.0, 2.0, 3.0, 50.0))]
    (case,) = group_results(runs).cases
    table = case_table(case)
    row = cells(table, "bc")
    assert row["return"] == mean_interval(case.metric("bc", "return"))
    assert row["success"] == rate_interval(case.metric("bc", "success"))
    assert row["success"].low < 0.75 < row["success"].high  # runs agree, episodes differ
    assert f"95 % interval for {TARGET_OF_SEVERAL}]" in table.caption
    assert table == case_table(case)  # repeatable


@pytest.mark.parametrize("key", QUANTITIES)
def test_every_interval_stays_in_the_range_of_its_quantity(key: str) -> None:
    one, *others = (result(index=k) for k in range(3))
    found = one.evaluation.metrics
    alone = {"robot_collisions": 40.0, "obstacle_collisions": 40.0, "success": 1.0}
    changed = {name: np.full_like(found[name], value) for name, value in alone.items()}
    changed["time_to_goal"] = np.zeros_like(found["time_to_goal"])
    differs = replace(one, evaluation=replace(one.evaluation, metrics={**found, **changed}))
    (case,) = group_results([differs, *others]).cases
    ranges = {"success": (0, 1), "clean_success": (0, 1), "time_to_goal": (0, case.time_limit)}
    ranges |= dict.fromkeys(("robot_collisions", "obstacle_collisions"), (0, math.inf))
    least, most = ranges.get(key, (-math.inf, math.inf))
    value, low, high = cells(case_table(case), "bc")[key]
    assert least <= low <= value <= high <= most
    if key == "robot_collisions":
        assert mean_interval(case.metric("bc", key)).low < 0.0 == low
        assert collisions_and_returns(case)["bc"][0].low == 0.0


def test_the_data_come_first_without_an_interval() -> None:
    (case,) = group_results([result()]).cases
    table = case_table(case)
    own = cells(table, f"data of {MEDIUM}")
    entry = published()[MEDIUM]
    assert own["return"].value == entry.mean_return
    assert own["clean_success"].value == entry.clean_success
    assert math.isnan(own["return"].low)
    assert math.isnan(own["robot_collisions"].value)
    assert table.rows[0].n_runs == 0
    assert "20 episodes of coop_nav on the evaluation seeds" in table.caption
    assert "observation state, communication none" in table.caption
    run = result()
    chosen = replace(run, evaluation=replace(run.evaluation, seeds=validation_seeds(20)))
    (case,) = group_results([chosen]).cases
    assert "20 episodes of coop_nav on the validation seeds" in case_table(case).caption


def test_other_environments_have_their_own_columns() -> None:
    made = foreign(**{"return": [1.0, 2.0], "length": [3.0, 5.0], "success": [math.nan] * 2})
    (case,) = group_results([made]).cases
    table = case_table(case)
    row = cells(table, "bc")
    assert list(row) == ["return", "success", "length"]
    assert row["length"].value == 4.0
    assert math.isnan(row["success"].value)
    assert "counting_v1 of another library" in table.caption


def test_labels_by_dataset() -> None:
    results = group_results([*grid(MEANS), *grid({"iql": {MEDIUM: 0.0}}), result("idle", None)])
    table = score_table(results)
    assert [row.label for row in table.rows] == ["data", "iql", "bc", "omar"]
    assert [column.label for column in table.columns] == [MEDIUM, EXPERT]
    row = cells(table, "bc")
    assert row[EXPERT] == mean_interval(results.case(EXPERT).scores("bc"))
    assert cells(table, "data")[EXPERT].value == results.case(EXPERT).data_score
    assert math.isnan(cells(table, "iql")[EXPERT].value)


def test_views_are_explained() -> None:
    lidar = with_models(COOP_NAV, "lidar")
    models = json.dumps(models_of(lidar))
    strict = '{"rewards":{"robot_collision":1.5,"time":0.0}}'
    results = [result(), result(spec=lidar, view=models), result("safe", view=strict)]
    table = score_table(group_results(results))
    keys = [each.provenance.dataset_key for each in results]
    assert f" {keys[1]}: re-observed with observation lidar" in table.caption
    words = "safe learned from rewards with robot_collision 1.5, time 0."
    assert f" {MEDIUM}: {words}" in table.caption
    assert table.caption.count(": re-observed") == table.caption.count(" learned from") == 1


def test_aggregates_stand_below_those_of_the_data() -> None:
    results = group_results([*grid(MEANS), *grid({"iql": {MEDIUM: 0.0}, "vdn": {MEDIUM: 0.0}})])
    table = aggregate_table(results)
    assert [row.label for row in table.rows] == ["data", "bc", "omar"]
    own = [case.data_score for case in results.cases]
    assert cells(table, "data")["mean"].value == pytest.approx(np.mean(own))  # type: ignore[arg-type]
    assert f"; iql, vdn left out, not measured on {EXPERT})" in table.caption


def test_who_is_better_by_how_much() -> None:
    results = group_results(grid(MEANS))
    table = difference_table(results)
    means = {label: np.mean([x.mean() for x in results.scores[label].values()]) for label in MEANS}
    gap = cells(table, "omar")["bc"]
    assert gap.value == pytest.approx(means["omar"] - means["bc"])
    assert cells(table, "bc")["omar"].value == pytest.approx(-gap.value)
    assert gap.low < gap.value < gap.high
    assert math.isnan(cells(table, "bc")["bc"].value)
    assert "paired by episode" in table.caption


def test_without_collisions_a_small_budget_is_not_yet_kept() -> None:
    made = result(n=60)
    none = dict.fromkeys(("robot_collisions", "obstacle_collisions"), np.zeros(60))
    metrics = {**made.evaluation.metrics, **none}
    (case,) = group_results(
        [replace(made, evaluation=replace(made.evaluation, metrics=metrics))]
    ).cases
    for name in none:
        value, low, high = cells(case_table(case), "bc")[name]
        assert value == low == 0.0
        assert high == pytest.approx(3.689 / 60, rel=1e-3)
    for budget, is_kept in ((0.05, False), (0.07, True)):
        table = budget_table(case, {"robot_collisions": budget})
        value, low, high = cells(table, "bc")["robot_collisions_over_budget"]
        assert value == low == -budget
        assert (high <= 0.0) == is_kept


def test_one_episode_over_a_budget_is_no_more_certain_than_none() -> None:
    found = []
    for n_over in (0, 1):
        made = [result(index=k, n=60) for k in range(5)]
        costs = np.zeros((5, 60))
        costs[0, :n_over] = 1.0
        (case,) = group_results(
            [
                replace(each, evaluation=replace(
                    each.evaluation, metrics={**each.evaluation.metrics, "robot_collisions": row}
                ))
                for each, row in zip(made, costs, strict=True)
            ]
        ).cases  # fmt: skip
        row = cells(budget_table(case, {"robot_collisions": 0.5}), "bc")
        found.append(row["robot_collisions_over_budget_share"].high)
    assert found[0] <= found[1]


def test_a_budget_is_kept_or_not() -> None:
    made = result(n=40)
    (case,) = group_results([made]).cases
    costs = made.evaluation.metrics["robot_collisions"]
    row = cells(budget_table(case, {"robot_collisions": 0.25}), "bc")

    assert row["robot_collisions_over_budget"].value == pytest.approx(costs.mean() - 0.25)
    assert row["robot_collisions_over_budget_share"].value == (costs > 0.25).mean()
