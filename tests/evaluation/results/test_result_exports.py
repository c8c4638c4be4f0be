"""Other tools get the numbers that were measured, in their schema."""

import json

import numpy as np
import pytest

from swarmdata.evaluation.results.result_exports import episode_values, marl_eval, runs_csv
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import metrics_of
from tests.support.measured import EXPERT, MEANS, MEDIUM, csv_rows, grid, result


def test_one_row_per_run_with_every_metric() -> None:
    results = group_results([*grid(MEANS), result("idle", None)])
    rows = csv_rows(runs_csv(results))
    assert len(rows) == 2 * 2 * 3 + 1
    assert set(metrics_of("coop_nav")) < set(rows[0])
    assert {row["dataset"] for row in rows} == {MEDIUM, EXPERT, ""}
    (row,) = (r for r in rows if (r["label"], r["dataset"], r["seed"]) == ("bc", EXPERT, "2"))
    case = results.case(EXPERT)
    assert float(row["return"]) == case.metric("bc", "return")[2].mean()
    assert float(row["score"]) == case.scores("bc")[2].mean()
    assert float(row["time_to_goal"]) == pytest.approx(0.75 * 6.0 + 0.25 * 16.0)
    assert row["updates"] == "1000"
    assert row["frames"] == ""


def test_marl_eval_is_nested_as_its_readme_says() -> None:
    results = group_results(
        [*grid(MEANS), *grid({"iql": {MEDIUM: 0.0}}), *grid({"few": MEANS["bc"]}, 2)]
    )
    document, left_out = marl_eval(results)
    assert left_out == ["iql", "few"]
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert set(document) == {"coop_nav"}
    assert set(document["coop_nav"]) == {MEDIUM, EXPERT}
    for task in document["coop_nav"].values():
        assert set(task) == {"bc", "omar"}
        for runs in task.values():
            assert list(runs) == ["run_0", "run_1", "run_2"]
            for steps in runs.values():
                assert list(steps) == ["step_1", "absolute_metrics"]  # absolute ones are last
                assert steps["step_1"]["step_count"] == 1000
                assert {*steps["step_1"]} == {"step_count", *steps["absolute_metrics"]}
    run = document["coop_nav"][EXPERT]["omar"]["run_1"]
    case = results.case(EXPERT)
    values = episode_values(case, case.runs["omar"][1])
    assert run["absolute_metrics"]["return"] == pytest.approx(values["return"], rel=1e-5)
    assert run["step_1"]["return"] == pytest.approx(values["return"][:2], rel=1e-5)
    assert run["absolute_metrics"]["score"] == pytest.approx([values["score"].mean()], rel=1e-5)


def test_marl_eval_leaves_out_what_is_undefined_somewhere() -> None:
    results = grid(MEANS)
    results[0].evaluation.metrics["min_separation"][3] = np.nan
    document, _ = marl_eval(group_results(results))
    runs = document["coop_nav"][EXPERT]["omar"]["run_0"]
    assert "min_separation" not in runs["absolute_metrics"]
    assert "time_to_goal" in runs["absolute_metrics"]  # censored, so defined


def test_without_datasets_the_tasks_stand_for_themselves() -> None:
    n8 = preset("coop_nav-n8")
    results = group_results([result("idle", None), result("idle", None, spec=n8)])
    document, _ = marl_eval(results)
    assert [name.rpartition("-")[0] for name in document["coop_nav"]] == ["coop_nav", "coop_nav"]
    assert len(document["coop_nav"]) == 2
