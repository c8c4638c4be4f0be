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
    axis_drawing,
    interval_drawing,
    line_chart,
    nice_axis,
    score_axis,
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


def test_an_interval_is_a_disc_on_its_line() -> None:
    found = [Estimate(50.1, 40.2, 60.0), Estimate(10.0, math.nan, math.nan)]
    axis = score_axis(found, 30.0, low=-50.0)

    tree = ElementTree.fromstring(interval_drawing(found[0], axis, 30.0, 2))

    data, line = tree.iter("line")
    (disc,) = tree.iter("circle")
    ends = float(line.attrib["x1"]), float(line.attrib["x2"])
    assert ends[0] < float(disc.attrib["cx"]) == pytest.approx(sum(ends) / 2, abs=0.1)
    assert float(data.attrib["x1"]) == pytest.approx(axis.place(30.0), abs=0.06)
    assert "series-2" in tree.attrib["class"]
    alone = ElementTree.fromstring(interval_drawing(found[1], axis, None, 0))
    assert not list(alone.iter("line"))
    assert len(list(alone.iter("circle"))) == 1
    undefined = interval_drawing(Estimate(math.nan, math.nan, math.nan), axis, None, 0)
    assert "<circle" not in undefined
    assert not re.search(r"\d\.\d{2,}\"", ElementTree.tostring(tree).decode()), "short numbers"


def test_a_row_far_below_does_not_squeeze_the_others() -> None:
    found = [Estimate(90.0, 88.0, 92.0), Estimate(-400.0, -420.0, -380.0)]
    axis = score_axis(found, None, low=-50.0)

    below = ElementTree.fromstring(interval_drawing(found[1], axis, None, 0))

    assert axis.low >= -50
    assert [node.get("class") for node in below.iter("path")] == ["beyond"]
    assert not list(below.iter("circle"))
    assert [node.text for node in ElementTree.fromstring(axis_drawing(axis)).iter("text")] == [
        "-50",
        "100",
        "0",
    ]


@given(heights=st.lists(st.floats(0, 100), min_size=1, max_size=40))
def test_labels_of_lines_do_not_cover_each_other(heights: list[float]) -> None:
    lines = {
        f"line-{k}": {0.0: Estimate(0, 0, 0), 1.0: Estimate(y, y - 1, y + 1)}
        for k, y in enumerate(heights)
    }

    text = line_chart(lines, dict.fromkeys(lines, 0), "updates", "success (%)", "title")

    tree = ElementTree.fromstring(text)
    labels = sorted(
        float(node.attrib["y"]) for node in tree.iter("text") if node.get("class") == "name"
    )
    height = float(tree.attrib["viewBox"].split()[3])
    assert len(labels) == len(heights)
    assert all(b - a > LABEL_HEIGHT - 0.2 for a, b in pairwise(labels))
    assert labels[0] > 0
    assert labels[-1] < height


def test_lines_of_one_color_have_dashes() -> None:
    line = {0.0: Estimate(0, 0, 0), 1.0: Estimate(1, 0, 2)}
    series = {"bc": 0, "iql": 2, "bc-4x": 0}

    text = line_chart(dict.fromkeys(series, line), series, "updates", "score", "title")

    found = [node.get("class") for node in ElementTree.fromstring(text).iter("g")][1:]
    assert found == ["line series-0 dashed-0", "line series-2 dashed-0", "line series-0 dashed-1"]
    assert "bc, 4 × updates" in text
