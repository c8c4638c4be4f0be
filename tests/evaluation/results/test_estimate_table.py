"""Tables are written in one format, whatever is in a name."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column, Row, Table
from swarmdata.rollouts.score_statistics import Estimate
from tests.support.measured import csv_rows

TABLE = Table(
    (Column("score", "score", "", 1), Column("success", "success", "%", 1, 100.0)),
    (
        Row("straight", 1, (Estimate(-0.04, -1.26, 1.0), Estimate(0.305, 0.28, 0.335))),
        Row("bc|x", 5, (Estimate(101.25, 99.0, 103.0), Estimate(math.nan, math.nan, math.nan))),
        Row("data", 0, (Estimate(3.0, math.nan, math.nan), Estimate(0.5, 0.4, 0.6))),
    ),
    "The caption.",
)


def test_markdown() -> None:
    assert TABLE.to_markdown() == (
        "| policy | runs | score | success (%) |\n"
        "| --- | ---: | ---: | ---: |\n"
        "| straight | 1 | 0.0 [-1.3, 1.0] | 30.5 [28.0, 33.5] |\n"
        "| bc\\|x | 5 | 101.2 [99.0, 103.0] | – |\n"
        "| data | – | 3.0 | 50.0 [40.0, 60.0] |\n"
        "\nThe caption.\n"
    )


def test_text_is_aligned() -> None:
    assert TABLE.to_text() == (
        "policy    runs                score        success (%)\n"
        "──────────────────────────────────────────────────────\n"
        "straight     1      0.0 [-1.3, 1.0]  30.5 [28.0, 33.5]\n"
        "bc|x         5  101.2 [99.0, 103.0]                  –\n"
        "data         –                  3.0  50.0 [40.0, 60.0]\n"
        "\nThe caption.\n"
    )


def test_csv_has_every_bit() -> None:
    rows = csv_rows(TABLE.to_csv())
    assert list(rows[0])[:5] == ["policy", "runs", "score", "score_low", "score_high"]
    assert float(rows[0]["success_high"]) == 0.335
    assert rows[1]["policy"] == "bc|x"
    assert rows[1]["success"] == ""


def test_latex() -> None:
    lines = TABLE.to_latex().splitlines()
    assert "  \\begin{tabular}{lrrr}" in lines
    assert "    policy & runs & score & success (\\%) \\\\" in lines
    assert "    bc|x & 5 & 101.2 [99.0, 103.0] & -- \\\\" in lines


@given(st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), min_size=1))
def test_latex_is_text_whatever_the_name_is(name: str) -> None:
    table = Table(TABLE.columns, (Row(name, 1, TABLE.rows[0].estimates),), "")
    (line,) = (line for line in table.to_latex().splitlines() if "0.0 [" in line)
    cell = line.strip().split(" & ")[0]
    plain = re.sub(r"\\text[a-z]+\{\}|\\[&%$#_{}]", "", cell.removeprefix("{[").removesuffix("}"))
    assert not re.search(r"[&%$#_~^\\]", plain)
    assert not cell.startswith("[")


def test_panels_are_columns_in_shown_units() -> None:
    panels = TABLE.panels(["success", "score"])
    assert list(panels) == ["success (%)", "score"]
    assert panels["success (%)"]["straight"] == pytest.approx((30.5, 28.0, 33.5))
    assert list(panels["score"]) == ["straight", "bc|x", "data"]
    with pytest.raises(UnknownNameError, match=r"unknown column 'scor'. Did you mean 'score'"):
        TABLE.panels(["scor"])
