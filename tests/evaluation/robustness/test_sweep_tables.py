"""Tables of sweeps: what is said of teams along an axis, with every number."""

import csv
import io
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.robustness.sweep_tables import (
    CSV_COLUMNS,
    Degradation,
    Line,
    Point,
    to_csv,
)
from swarmdata.rollouts.score_intervals import TARGET_OF_ONE, TARGET_OF_SEVERAL
from swarmdata.rollouts.score_statistics import Estimate

COLUMNS = (Column("return", "return", "", 2), Column("success", "success", "%", 1, 100.0))
NUMBERS = st.floats(allow_infinity=False)


def degradation(*lines: Line) -> Degradation:
    return Degradation("communication", "drop", COLUMNS, lines, 5, falls=False)


def point(value: float | None, *numbers: float, is_trained: bool = False) -> Point:
    return Point(value, is_trained, tuple(Estimate(n, n - 0.5, n + 0.5) for n in numbers))


MEASURED = degradation(
    Line("several", 3, (point(0.0, 1.0, 0.5), point(0.3, 0.5, 0.25, is_trained=True))),
    Line("one", 1, (point(None, 2.0, 1.0, is_trained=True), point(0.3, -0.5, math.nan))),
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
    rows = list(csv.DictReader(io.StringIO(to_csv([MEASURED]))))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert len(rows) == 2 * 4
    undefined = [row for row in rows if row["estimate"] == ""]
    assert [(row["policy"], row["metric"], row["low"]) for row in undefined] == [
        ("one", "success", "")
    ]
    assert [row["as_trained"] for row in rows if row["metric"] == "return"] == ["0", "1", "1", "0"]
    assert {row["value"] for row in rows if row["policy"] == "one"} == {"", "0.3"}


@given(st.floats(0, 1), st.tuples(NUMBERS, NUMBERS, NUMBERS))
def test_csv_keeps_every_bit(value: float, numbers: tuple[float, float, float]) -> None:
    estimates = (Estimate(*numbers), Estimate(0.0, 0.0, 0.0))
    line = Line("a", 1, (Point(value, True, estimates),))
    row = next(csv.DictReader(io.StringIO(to_csv([degradation(line)]))))
    assert float(row["value"]) == value
    for text, number in zip((row["estimate"], row["low"], row["high"]), numbers, strict=True):
        assert float(text) == number if text else math.isnan(number)


def test_unknown_columns_are_named() -> None:
    assert MEASURED.column("success") == 1
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        MEASURED.column("successful")
