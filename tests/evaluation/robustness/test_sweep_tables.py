"""Tables of sweeps: what is said of teams along an axis, with every number."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.robustness.sweep_tables import (
    Degradation,
    Point,
    TeamLine,
    read_csv,
    write_csv,
)
from swarmdata.rollouts.score_intervals import TARGET_OF_ONE, TARGET_OF_SEVERAL
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.measured import csv_rows

COLUMNS = (Column("return", "return", "", 2), Column("success", "success", "%", 1, 100.0))


def degradation(*lines: TeamLine) -> Degradation:
    return Degradation("communication", "drop", COLUMNS, lines, 5, falls=False)


def point(value: float | None, *numbers: float, is_trained: bool = False) -> Point:
    return Point(value, is_trained, tuple(Estimate(n, n - 0.5, n + 0.5) for n in numbers))


MEASURED = degradation(
    TeamLine("several", 3, (point(0.0, 1.0, 0.5), point(0.3, 0.5, 0.25, is_trained=True))),
    TeamLine("one", 1, (point(None, 2.0, 1.0, is_trained=True), point(0.3, -0.5, math.nan))),
)


def test_markdown_says_what_changes_and_which_interval_is_meant() -> None:
    text = MEASURED.to_markdown()
    assert text.startswith("## communication drop\n\n| policy | runs | return | success (%) |\n")
    assert "| several, drop 0.3 (as trained) | 3 | 0.50 [0.00, 1.00] | 25.0 [-25.0, 75.0] |" in text
    assert "| one, as trained | 1 | 2.00 [1.50, 2.50] |" in text
    assert "| one, drop 0.3 | 1 | -0.50 [-1.00, 0.00] | – |" in text
    assert TARGET_OF_SEVERAL in text
    assert TARGET_OF_ONE in text
    assert TARGET_OF_ONE not in degradation(MEASURED.lines[0]).to_markdown()
    assert TARGET_OF_SEVERAL not in degradation(MEASURED.lines[1]).to_markdown()


def test_another_world_than_that_of_training_is_not_called_that() -> None:
    text = replace(MEASURED, as_trained=False).to_markdown()
    assert "trained" not in text.replace("training seed", "")
    assert "| several, drop 0.3 (not varied) | 3 |" in text
    assert "| one, not varied | 1 |" in text


def test_csv_has_one_estimate_in_a_row() -> None:
    rows = csv_rows(write_csv([MEASURED]))
    assert list(rows[0])[:4] == ["part", "parameter", "value", "as_trained"]
    assert len(rows) == 2 * 4
    undefined = [row for row in rows if row["estimate"] == ""]
    assert [(row["policy"], row["metric"], row["low"]) for row in undefined] == [
        ("one", "success", "")
    ]
    assert [row["as_trained"] for row in rows if row["metric"] == "return"] == ["0", "1", "1", "0"]
    assert {row["value"] for row in rows if row["policy"] == "one"} == {"", "0.3"}


def test_the_csv_is_read_back(tmp_path: Path) -> None:
    file = tmp_path / "sweep.csv"
    file.write_text(write_csv([MEASURED]))
    assert write_csv([read_csv(file)]) == file.read_text()
    found = read_csv(file)
    assert found.columns == tuple(QUANTITIES[key].column for key in ("return", "success"))
    assert not found.falls
    assert [line.trained.value for line in found.lines] == [0.3, None]


def test_unknown_columns_are_named() -> None:
    assert MEASURED.column("success") == 1
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        MEASURED.column("successful")
