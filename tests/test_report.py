"""Tables show the right numbers, in one format, with the right interval."""

import csv
import io
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from swarmdata import metrics
from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.metrics import Estimate, Reference, metrics_of
from swarmdata.report import Column, Row, Table, format_estimate, format_number, results_table
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.types import EvalResult

METRICS = metrics_of("coop_nav")

SPEC = TaskSpec()  # 160 steps of 0.1 s
N_EPISODES = 40


def result(policy: str = "bc", *, shift: float = 0.0, **changes: Any) -> EvalResult:
    rng = np.random.default_rng(7)
    values = {name: rng.random(N_EPISODES) for name in METRICS}
    values["return"] += shift
    values["success"] = (np.arange(N_EPISODES) < 30).astype(float)
    values["clean_success"] = (np.arange(N_EPISODES) < 10).astype(float)
    values["time_to_goal"] = np.where(values["success"] > 0, 6.0, np.nan)
    made = EvalResult(policy, "coop_nav", SPEC.hash(), evaluation_seeds(N_EPISODES), values)
    return replace(made, **changes)


def cells(table: Table, row: int = 0) -> dict[str, Estimate]:
    keys = [column.key for column in table.columns]
    return dict(zip(keys, table.rows[row].estimates, strict=True))


def test_one_run_is_averaged_over_episodes() -> None:
    made = result()
    row = cells(results_table({"bc": [made]}, SPEC, reference=Reference(0.0, 2.0)))
    assert next(iter(row)) == "score"
    mean = made.metrics["return"].mean()
    assert row["return"].value == pytest.approx(mean)
    assert row["score"].value == pytest.approx(50 * mean)
    assert row["score"].low == pytest.approx(50 * row["return"].low, rel=0.05)
    standard_error = made.metrics["return"].std() / math.sqrt(N_EPISODES)
    assert row["return"].high - mean == pytest.approx(1.96 * standard_error, rel=0.15)
    assert row["success"] == metrics.wilson_interval(30, 40)
    assert row["clean_success"] == metrics.wilson_interval(10, 40)
    assert row["time_to_goal"].value == pytest.approx((30 * 6.0 + 10 * 16.0) / 40)


def test_the_title_says_the_models() -> None:
    title = results_table({"bc": [result()]}, SPEC).caption
    assert "40 episodes of coop_nav on the evaluation seeds" in title
    assert "observation state, communication none" in title


def test_several_runs_give_the_iqm_over_runs() -> None:
    runs = [result(shift=s) for s in (0.0, 1.0, 2.0, 3.0, 50.0)]
    table = results_table({"bc": runs, "other": [result()]}, SPEC)
    base = runs[0].metrics["return"].mean()
    row = cells(table)
    assert row["return"].value == pytest.approx(base + 2.0)
    assert base <= row["return"].low < row["return"].value < row["return"].high
    assert row["success"] == Estimate(0.75, 0.75, 0.75)  # all runs agree
    assert [r.n_runs for r in table.rows] == [5, 1]
    assert "interquartile mean" in table.caption
    assert "score" not in row


def test_a_table_is_repeatable() -> None:
    runs = {"a": [result()], "b": [result(shift=1.0), result(shift=2.0)]}
    assert results_table(runs, SPEC) == results_table(runs, SPEC)


def test_results_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(SchemaError, match="are of different specs"):
        results_table({"a": [result()], "b": [result(spec_hash="0" * 64)]}, SPEC)
    with pytest.raises(SchemaError, match="stale or of another task"):
        results_table({"a": [result()]}, TaskSpec(horizon=10))
    with pytest.raises(SchemaError, match="'b' has no results"):
        results_table({"a": [result()], "b": []}, SPEC)
    with pytest.raises(SchemaError, match="no results to compare"):
        results_table({}, SPEC)


TABLE = Table(
    (Column("score", "score", "", 1), Column("success", "success", "%", 1, 100.0)),
    (
        Row("straight", 1, (Estimate(-0.04, -1.26, 1.0), Estimate(0.305, 0.28, 0.335))),
        Row("bc|x", 5, (Estimate(101.25, 99.0, 103.0), Estimate(math.nan, math.nan, math.nan))),
    ),
    "The caption.",
)


def test_markdown() -> None:
    assert TABLE.to_markdown() == (
        "| policy | runs | score | success (%) |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| straight | 1 | 0.0 [-1.3, 1.0] | 30.5 [28.0, 33.5] |\n"
        "| bc\\|x | 5 | 101.2 [99.0, 103.0] | – |\n"
        "\nThe caption.\n"
    )


def test_text_is_aligned() -> None:
    assert TABLE.to_text() == (
        "policy    runs                score        success (%)\n"
        "──────────────────────────────────────────────────────\n"
        "straight     1      0.0 [-1.3, 1.0]  30.5 [28.0, 33.5]\n"
        "bc|x         5  101.2 [99.0, 103.0]                  –\n"
        "\nThe caption.\n"
    )


def test_csv_has_every_bit() -> None:
    rows = list(csv.DictReader(io.StringIO(TABLE.to_csv())))
    assert list(rows[0])[:5] == ["policy", "runs", "score", "score_low", "score_high"]
    assert float(rows[0]["success_high"]) == 0.335
    assert rows[1]["policy"] == "bc|x"
    assert rows[1]["success"] == ""


def test_numbers_are_written_in_one_way() -> None:
    percent = Column("success", "success", "%", 1, 100.0)
    assert format_number(0.12345, percent) == "12.3"
    assert format_number(-0.0001, percent) == "0.0"
    assert format_number(-0.01, percent) == "-1.0"
    assert format_estimate(Estimate(0.5, 0.4, 0.6), percent) == "50.0 [40.0, 60.0]"
    assert percent.header == "success (%)"


def test_panels_are_columns_in_shown_units() -> None:
    panels = TABLE.panels(["success", "score"])
    assert list(panels) == ["success (%)", "score"]
    assert panels["success (%)"]["straight"] == pytest.approx((30.5, 28.0, 33.5))
    assert list(panels["score"]) == ["straight", "bc|x"]
    with pytest.raises(UnknownNameError, match=r"unknown column 'scor'. Did you mean 'score'"):
        TABLE.panels(["scor"])
