"""A chart of estimates: a row for each label, its mean as a disc on the line of its interval."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.drawings.axes import Axis, nice_axis
from swarmdata.catalogue.elements import Html, element
from swarmdata.rollouts.score_statistics import Estimate

WIDTH, LABEL_WIDTH, ROW_HEIGHT, TOP, BOTTOM, RIGHT = 680.0, 190.0, 24.0, 10.0, 44.0, 70.0
N_COLORS = 6
"""Colors of series, `--series-0` and so on in the style sheet."""


@dataclass(frozen=True)
class Bar:
    """One row."""

    label: str
    estimate: Estimate  # in shown units
    series: int  # which color
    note: str = ""  # more about it, shown on hovering
    href: str = ""  # the page of its runs and episodes; empty: there is none


def estimate_chart(bars: Sequence[Bar], quantity: str, title: str, data: float | None) -> Html:
    """Draws estimates, in the given order.

    Args:
        bars: from top to bottom; those with undefined means are left out.
        quantity: what the axis shows, with its unit.
        title: for screen readers.
        data: the mean of the dataset's own episodes, a dashed line; None: not known.
    """
    rows = [bar for bar in bars if not math.isnan(bar.estimate.value)]
    ends = [value for bar in rows for value in bar.estimate if not math.isnan(value)]
    axis = nice_axis([*ends, *([] if data is None else [data])], LABEL_WIDTH, WIDTH - RIGHT)
    height = TOP + ROW_HEIGHT * len(rows) + BOTTOM
    base = height - BOTTOM
    parts = [_ticks(axis, base, quantity)]
    if data is not None:
        x = axis.place(data)
        parts.append(svg_shapes.line((x, TOP), (x, base), class_="data"))
        parts.append(svg_shapes.text((x, base + 38), "data", class_="data", text_anchor="middle"))
    parts += [_row(bar, TOP + ROW_HEIGHT * (k + 0.5), axis) for k, bar in enumerate(rows)]
    role = "group" if any(bar.href for bar in rows) else "img"  # links are no part of an image
    return svg_shapes.drawing(WIDTH, height, title, *parts, class_="chart", role=role)


def _ticks(axis: Axis, base: float, quantity: str) -> Html:
    parts = []
    for tick in axis.ticks:
        x = axis.place(tick)
        parts.append(svg_shapes.line((x, TOP), (x, base), class_="grid"))
        parts.append(svg_shapes.text((x, base + 15), axis.label(tick), text_anchor="middle"))
    parts.append(
        svg_shapes.text((WIDTH - RIGHT, base + 38), quantity, text_anchor="end", class_="quantity")
    )
    return element("g", *parts, class_="axis")


def _row(bar: Bar, y: float, axis: Axis) -> Html:
    value, low, high = bar.estimate
    inside = []
    if not math.isnan(low):
        inside.append(svg_shapes.line((axis.place(low), y), (axis.place(high), y)))
    inside.append(svg_shapes.disc((axis.place(value), y), 4.5))
    mark = element("g", *inside, class_=f"mark series-{bar.series}")
    name = svg_shapes.text((LABEL_WIDTH - 12, y + 4), bar.label, text_anchor="end")
    shown = svg_shapes.text((WIDTH - RIGHT + 14, y + 4), axis.label(value, extra=1), class_="value")
    inside = [element("title", f"{bar.label}: {bar.note}"), name, mark, shown]
    return element("a", *inside, href=bar.href) if bar.href else element("g", *inside)
