"""A chart of lines with bands: learning curves, and how teams degrade along an axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.drawings.axes import Axis, nice_axis
from swarmdata.catalogue.drawings.estimate_chart import N_COLORS
from swarmdata.catalogue.elements import Html, element

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 680.0, 52.0, 170.0, 28.0, 44.0
LEAST_HEIGHT = 300.0
LABEL_HEIGHT = 15.0
MOST_BANDS = 8
"""Lines up to which bands are drawn: more would hide each other."""

N_DASHES = 3
"""Kinds of dashes, which change once the colors repeat."""


@dataclass(frozen=True)
class PlottedPoint:
    """A mean and its interval at one place of the axis."""

    x: float
    value: float
    low: float
    high: float


def line_chart(
    lines: Mapping[str, Sequence[PlottedPoint]], x_name: str, y_name: str, title: str
) -> Html:
    """Draws a line with a band for each label; labels stand beside the ends of their lines.

    Args:
        lines: label -> points in the order of the axis; none is empty.
        x_name: of the horizontal axis, with its unit.
        y_name: of the vertical axis, with its unit.
        title: for screen readers.
    """
    points = [point for line in lines.values() for point in line]
    height = max(LEAST_HEIGHT, TOP + BOTTOM + LABEL_HEIGHT * len(lines))
    across = nice_axis([point.x for point in points], LEFT, WIDTH - RIGHT)
    ends = [value for point in points for value in (point.value, point.low, point.high)]
    up = nice_axis(ends, height - BOTTOM, TOP)
    parts = [_axes(across, up, x_name, y_name)]
    heights = _spread({label: up.place(line[-1].value) for label, line in lines.items()}, up.start)
    for k, (label, line) in enumerate(lines.items()):
        has_band = len(lines) <= MOST_BANDS
        parts.append(_line(label, line, across, up, heights[label], k, has_band=has_band))
    return svg_shapes.drawing(WIDTH, height, title, *parts, class_="chart")


def _axes(across: Axis, up: Axis, x_name: str, y_name: str) -> Html:
    base, parts = up.start, []
    for tick in up.ticks:
        y = up.place(tick)
        parts.append(svg_shapes.line((LEFT, y), (WIDTH - RIGHT, y), class_="grid"))
        parts.append(svg_shapes.text((LEFT - 8, y + 4), up.label(tick), text_anchor="end"))
    for tick in across.ticks:
        x = across.place(tick)
        parts.append(svg_shapes.text((x, base + 16), across.label(tick), text_anchor="middle"))
    parts.append(svg_shapes.text((WIDTH - RIGHT, base + 36), x_name, text_anchor="end"))
    parts.append(svg_shapes.text((LEFT, TOP - 12), y_name, class_="quantity"))
    return element("g", *parts, class_="axis")


def _line(
    label: str,
    line: Sequence[PlottedPoint],
    across: Axis,
    up: Axis,
    label_y: float,
    k: int,
    *,
    has_band: bool,
) -> Html:
    means = [(across.place(point.x), up.place(point.value)) for point in line]
    low = [(across.place(point.x), up.place(point.low)) for point in line]
    high = [(across.place(point.x), up.place(point.high)) for point in line]
    name = svg_shapes.text((WIDTH - RIGHT + 8, label_y + 4), label, class_="name")
    band = ""
    if has_band:
        band = svg_shapes.path([*low, *reversed(high)], closed=True, class_="band")
    looks = f"line series-{k % N_COLORS} dashed-{k // N_COLORS % N_DASHES}"
    return element("g", band, svg_shapes.path(means, class_="mean"), name, class_=looks)


def _spread(heights: Mapping[str, float], base: float) -> dict[str, float]:
    """Moves labels apart so that none covers another and none is below `base`."""
    found: dict[str, float] = {}
    lowest = base
    for label, height in sorted(heights.items(), key=lambda each: -each[1]):
        found[label] = lowest = min(height, lowest)
        lowest -= LABEL_HEIGHT
    highest = TOP
    for label, height in reversed(found.items()):
        found[label] = highest = max(height, highest)
        highest += LABEL_HEIGHT
    return found
