"""Charts: round axes that hold their values, and labels that do not cover each other."""

import math
import re
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.catalogue.drawings.charts import (
    LABEL_HEIGHT,
    Bar,
    estimate_chart,
    line_chart,
    nice_axis,
)
from swarmdata.rollouts.score_statistics import Estimate

VALUES = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(values=st.lists(VALUES, max_size=5))
def test_an_axis_holds_its_values_between_round_ends(values: list[float]) -> None:
    axis = nice_axis(values, 10.0, 20.0)

    for value in values:
        assert 10 - 1e-6 <= axis.place(value) <= 20 + 1e-6
    assert 2 <= len(axis.ticks) <= 10
    assert axis.place(axis.low) == 10
    assert all(axis.label(tick) for tick in axis.ticks)


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ([0.0, 100.0], ["0", "20", "40", "60", "80", "100"]),
        ([-0.1, 0.1], ["-0.10", "-0.05", "0.00", "0.05", "0.10"]),
    ],
)
def test_ticks_are_round(values: list[float], labels: list[str]) -> None:
    axis = nice_axis(values, 0.0, 1.0)

    assert [axis.label(tick) for tick in axis.ticks] == labels


def test_estimates_are_drawn_with_their_intervals() -> None:
    bars = [
        Bar("a<b", Estimate(50.0, 40.0, 60.0), 0, "5 seeds"),
        Bar("alone", Estimate(10.0, math.nan, math.nan), 1),
        Bar("undefined", Estimate(math.nan, math.nan, math.nan), 2),
    ]

    text = estimate_chart(bars, "score", "title", data=30.0)

    ElementTree.fromstring(text)
    assert "a&lt;b: 5 seeds" in text
    assert text.count("<circle") == 2
    assert "undefined" not in text
    assert text.count('class="data"') == 2


@given(heights=st.lists(st.floats(0, 100), min_size=1, max_size=40))
def test_labels_of_lines_do_not_cover_each_other(heights: list[float]) -> None:
    lines = {
        f"line-{k}": {0.0: Estimate(0, 0, 0), 1.0: Estimate(y, y - 1, y + 1)}
        for k, y in enumerate(heights)
    }

    text = line_chart(lines, "updates", "success (%)", "title")

    tree = ElementTree.fromstring(text)
    labels = sorted(
        float(node.attrib["y"]) for node in tree.iter("text") if node.get("class") == "name"
    )
    height = float(tree.attrib["viewBox"].split()[3])
    assert len(labels) == len(heights)
    assert all(b - a > LABEL_HEIGHT - 0.2 for a, b in pairwise(labels))
    assert labels[0] > 0
    assert labels[-1] < height


def test_numbers_in_drawings_are_short() -> None:
    bars = [Bar("a", Estimate(1 / 3, 0.1, 0.7), 0)]

    assert not re.search(r"\d\.\d{2,}\"", estimate_chart(bars, "score", "t", None))
