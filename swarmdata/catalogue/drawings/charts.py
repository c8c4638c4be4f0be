"""Charts as SVG, in the colors of the style sheet: estimates, lines with bands, rewards."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.elements import Html, element
from swarmdata.drawing.line_labels import spread_labels
from swarmdata.drawing.style import words_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double, Float

WIDTH, BOTTOM = 680.0, 44.0

MARK_WIDTH, MARK_HEIGHT, MARK_ROOM = 170.0, 18.0, 6.0
"""Of an interval in a row of a table, and room for half a disc at its ends."""

LINES_TOP, TICKS_WIDTH, LABELS_WIDTH, LEAST_HEIGHT, LABEL_HEIGHT = 28.0, 52.0, 170.0, 300.0, 15.0
"""Of a chart of lines."""

RIGHT = WIDTH - LABELS_WIDTH

MOST_BANDS = 8  # lines up to which bands are drawn: more would hide each other

N_COLORS = 6  # colors of agents, `--series-0` and so on in the style sheet

N_DASHES = 3  # kinds of dashes, of lines of one color

MOST_TICKS = 7

REWARDS_WIDTH, REWARDS_HEIGHT, MARGIN = 200.0, 130.0, 8.0
MOST_POINTS, MOST_AGENTS = 60, 12


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high`, drawn from `start` to `end`."""

    low: float
    high: float
    step: float
    start: float
    end: float

    def place(self, value: float) -> float:
        """Where a value is drawn."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    @property
    def ticks(self) -> list[float]:
        """Round values, from the lowest to the highest."""
        n = round((self.high - self.low) / self.step)
        return [self.low + k * self.step for k in range(n + 1)]

    def label(self, value: float) -> str:
        """A value with the decimals of the ticks."""
        decimals = max(0, -math.floor(math.log10(self.step) + 1e-9))
        text = f"{value:,.{decimals}f}"
        return text.removeprefix("-") if not float(text.replace(",", "")) else text


def nice_axis(values: Sequence[float], start: float, end: float) -> Axis:
    """Returns an axis that holds all values, with round ends; without any, it goes from 0 to 1."""
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    span = high - low or abs(high) or 1.0
    power = 10.0 ** math.floor(math.log10(span / MOST_TICKS))
    step = next(k * power for k in (1, 2, 5, 10) if k * power * MOST_TICKS >= span)
    first, last = math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step
    return Axis(first, last if last > first else first + step, step, start, end)


def score_axis(estimates: Sequence[Estimate], data: float | None, low: float) -> Axis:
    """Returns the axis of a table's intervals, and of the mean of the dataset's own episodes.

    It does not begin below `low`, so that one bad row does not squeeze the others.
    """
    ends = [end for each in estimates for end in each if not math.isnan(end)]
    ends += [] if data is None else [data]
    return nice_axis([max(end, low) for end in ends], MARK_ROOM, MARK_WIDTH - MARK_ROOM)


def interval_drawing(found: Estimate, axis: Axis, data: float | None, series: int) -> Html:
    """Draws an estimate as a disc on the line of its interval, for one row of a table.

    Below the axis, it is an arrow to the left. `data`, the mean of the dataset's own episodes if it
    is known, is an upright line.
    """
    middle, parts = MARK_HEIGHT / 2, []
    if data is not None:
        x = axis.place(data)
        parts.append(svg_shapes.line((x, 0), (x, MARK_HEIGHT), class_="data"))
    value, low, high = found
    if value < axis.low:
        tip = [(1.0, middle), (7.0, middle - 4), (7.0, middle + 4)]
        parts.append(svg_shapes.path(tip, closed=True, class_="beyond"))
    elif not math.isnan(value):
        if not math.isnan(low):
            ends = (axis.place(max(low, axis.low)), middle), (axis.place(high), middle)
            parts.append(svg_shapes.line(*ends))
        parts.append(svg_shapes.disc((axis.place(value), middle), 4))
    looks = f"interval mark series-{series}"
    return svg_shapes.picture(MARK_WIDTH, MARK_HEIGHT, *parts, class_=looks)


def axis_drawing(axis: Axis) -> Html:
    """Draws the ends of the axis of a table, and its zero where it is between them."""
    anchors = {axis.low: "start", axis.high: "end"}
    if axis.low < 0 < axis.high:
        anchors[0.0] = "middle"
    parts = [
        svg_shapes.text((axis.place(tick), 12), axis.label(tick), text_anchor=anchor)
        for tick, anchor in anchors.items()
    ]
    return svg_shapes.picture(MARK_WIDTH, MARK_HEIGHT, *parts, class_="interval axis")


Line = Mapping[float, Estimate]
"""Place on the horizontal axis, in its order -> estimate, in shown units."""


def line_chart(
    lines: Mapping[str, Line], series: Mapping[str, int], x_name: str, y_name: str, title: str
) -> Html:
    """Draws a line with a band for each label; labels stand beside the ends of their lines.

    Lines of one color, `series[label]`, differ in their dashes; the title is for screen readers.
    """
    height = max(LEAST_HEIGHT, LINES_TOP + BOTTOM + LABEL_HEIGHT * len(lines))
    base = height - BOTTOM
    across = nice_axis([x for line in lines.values() for x in line], TICKS_WIDTH, RIGHT)
    ends = [value for line in lines.values() for each in line.values() for value in each]
    up = nice_axis(ends, base, LINES_TOP)
    last = np.array([up.place([*line.values()][-1].value) for line in lines.values()])
    span = base - LINES_TOP
    places = LINES_TOP + span * spread_labels((last - LINES_TOP) / span, LABEL_HEIGHT / span)
    parts = [_axes(across, up, x_name, y_name)]
    for k, ((label, line), y) in enumerate(zip(lines.items(), places.tolist(), strict=True)):
        name = svg_shapes.text((RIGHT + 8, y + 4), words_of(label), class_="name")
        before = [series[other] for other in list(lines)[:k]].count(series[label])
        looks = f"line series-{series[label]} dashed-{before % N_DASHES}"
        shapes = _line(line, across, up, has_band=len(lines) <= MOST_BANDS)
        parts.append(element("g", *shapes, name, class_=looks))
    return svg_shapes.drawing(WIDTH, height, title, *parts, class_="chart")


def _axes(across: Axis, up: Axis, x_name: str, y_name: str) -> Html:
    base, parts = up.start, []
    for tick in up.ticks:
        y = up.place(tick)
        parts.append(svg_shapes.line((TICKS_WIDTH, y), (RIGHT, y), class_="grid"))
        parts.append(svg_shapes.text((TICKS_WIDTH - 8, y + 4), up.label(tick), text_anchor="end"))
    for tick in across.ticks:
        at = across.place(tick), base + 16
        parts.append(svg_shapes.text(at, across.label(tick), text_anchor="middle"))
    parts.append(svg_shapes.text((RIGHT, base + 36), x_name, text_anchor="end"))
    parts.append(svg_shapes.text((TICKS_WIDTH, LINES_TOP - 12), y_name, class_="quantity"))
    return element("g", *parts, class_="axis")


def _line(line: Line, across: Axis, up: Axis, *, has_band: bool) -> list[Html]:
    """The band of a line, if it has one, and the line."""
    means, low, high = (
        [(across.place(x), up.place(getattr(each, name))) for x, each in line.items()]
        for name in ("value", "low", "high")
    )
    mean = svg_shapes.path(means, class_="mean")
    band = svg_shapes.path([*low, *reversed(high)], closed=True, class_="band")
    return [band, mean] if has_band else [mean]


def rewards_drawing(rewards: Float, label: str) -> Html:
    """Draws the rewards of each agent so far, of [T, N], as a line."""
    shown = rewards[:, :MOST_AGENTS].astype(np.float64)
    sums = np.cumsum(np.where(np.isfinite(shown), shown, 0.0), axis=0)
    sums = np.concatenate([np.zeros_like(sums[:1]), sums])
    low, high = float(sums.min()), float(sums.max())
    rows = np.unique(np.linspace(0, len(sums) - 1, MOST_POINTS).astype(int))
    across = MARGIN + rows / max(1, len(sums) - 1) * (REWARDS_WIDTH - 2 * MARGIN)

    def up(values: Double) -> Double:
        share = (values - low) / (high - low or 1.0)
        return REWARDS_HEIGHT - MARGIN - share * (REWARDS_HEIGHT - 2 * MARGIN)

    zero = float(up(np.zeros(1))[0])
    lines = [
        svg_shapes.path(
            list(zip(across.tolist(), up(sums[rows, i]).tolist(), strict=True)),
            class_=f"series-{i % N_COLORS}",
        )
        for i in range(sums.shape[1])
    ]
    axis = svg_shapes.line((MARGIN, zero), (REWARDS_WIDTH - MARGIN, zero))
    return svg_shapes.drawing(REWARDS_WIDTH, REWARDS_HEIGHT, label, axis, *lines, class_="rewards")
