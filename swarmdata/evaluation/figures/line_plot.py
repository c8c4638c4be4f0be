"""Line plots: means in bands, in a grid of panels, named at the lines' ends or in a legend."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal, NamedTuple

from swarmdata.drawing.line_labels import label_ends
from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    DATA_LINE,
    GRAY,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    figure,
    thousands,
    words_of,
)
from swarmdata.types import Double

MARKED_POINTS = 6  # markers on a line, at most about

LINE: Mapping[str, Any] = {"lw": 1.4, "ms": 3}
RING: Mapping[str, Any] = {"marker": "o", "mfc": "white", "mew": 1.2, "ms": 5, "ls": ""}
OFF_AXIS: Mapping[str, Any] = {"lw": 1.1, "ls": (0, (1, 2))}


class Line(NamedTuple):
    """A line in its band."""

    label: str  # its name
    x: Double  # places on the horizontal axis, [P]
    ends: Double  # mean, low and high there, in shown units, [3, P]; NaN: no band
    look: Mapping[str, Any]  # color, dashes and marker, in matplotlib's words
    base: tuple[float | None, float] | None = None
    """(x, y) of what others are compared with: a ring; a dotted line if x is None."""


class LinePanel(NamedTuple):
    """Lines with the same axes."""

    title: str  # the models of a condition, behind `~`, are lines below its task
    lines: Sequence[Line]  # in the order of the legend
    xlabel: str = ""  # of the horizontal axis
    ylabel: str = ""  # of the vertical axis
    levels: Mapping[str, float] = {}  # label -> height of a dashed line, as the mean of the data
    limits: tuple[float, float] | None = None  # of the vertical axis; None: as far as lines reach
    xscale: str = "linear"  # such as `log`
    yscale: str = "linear"  # such as `symlog`
    ticks: Mapping[float, str] = {}  # place on the horizontal axis -> text; empty: matplotlib's
    falls: bool = False  # whether the horizontal axis falls from left to right
    counts: bool = False  # whether it has whole numbers


def plot_lines(
    rows: Sequence[Sequence[LinePanel]],
    path: Path,
    *,
    height: float,
    xlabel: str = "",
    ylabel: str = "",
    shares_x: bool = False,
    shares_y: Literal["all", "row", "none"] = "none",
    base: str | None = None,
) -> None:
    """Draws panels in rows from the top, each `height` inches high; rows may differ in length.

    The panels of a column may share the horizontal axis, all or those of a row the vertical one.
    `base` says what rings are, in a legend above the panels; without it, there is no legend, and
    lines have their names at their ends.
    """
    lines = [line for row in rows for panel in row for line in panel.lines]
    n_columns = max(map(len, rows))
    width = COLUMN_WIDTH if n_columns == 1 else max(PAGE_WIDTH, 2.1 * n_columns)
    with figure(path, width=width, height=0.5 + (height + 0.35) * len(rows)) as drawing:
        shared = {"sharey": shares_y, "sharex": "col" if shares_x else False}
        grid = drawing.subplots(len(rows), n_columns, squeeze=False, **shared)
        drawn = []
        for axes, panel in (p for each in zip(grid, rows, strict=True) for p in zip_longest(*each)):
            if panel is None:
                axes.set_visible(False)
            else:
                _draw_panel(axes, panel)
                drawn.append(axes)
        if base is not None:
            draw_legend(drawing, _handles(grid[0, 0], lines, base))
        for axes in drawn if base is None else ():  # the limits of shared axes are final
            axes.autoscale_view()  # which waits for the drawing otherwise
            named = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
            label_ends(axes, named, height)
        drawing.supxlabel(xlabel, fontsize=8)
        drawing.supylabel(ylabel, fontsize=8)


def _draw_panel(axes: Any, panel: LinePanel) -> None:
    for line in panel.lines:
        color, (mean, low, high) = line.look["color"], line.ends
        point = {"marker": "o"} if len(line.x) == 1 else {}  # a line of one point is invisible
        every = max(1, len(line.x) // MARKED_POINTS)
        look = {**LINE, **point, **line.look}
        axes.fill_between(line.x, low, high, color=color, alpha=0.16, lw=0)
        axes.plot(line.x, mean, markevery=every, label=line.label, **look)
        if line.base is not None and line.base[0] is not None:
            axes.plot(*([at] for at in line.base), mec=color, zorder=4, **RING)
        elif line.base is not None:
            axes.axhline(line.base[1], color=color, zorder=1, **OFF_AXIS)
    for label, level in panel.levels.items():
        axes.axhline(level, **DATA_LINE, zorder=1, label=label)
    title = panel.title.replace("~", "\n")
    axes.set_title(title, loc="left", fontsize=7.5, fontweight="bold")
    axes.set(xlabel=panel.xlabel, ylabel=panel.ylabel, xscale=panel.xscale, yscale=panel.yscale)
    if panel.limits is not None:
        axes.set_ylim(*panel.limits)
    axes.margins(x=0.02)
    axes.xaxis.set_major_formatter(thousands)
    if panel.ticks:
        axes.set_xticks(list(panel.ticks), list(panel.ticks.values()))
    if panel.counts:
        axes.xaxis.get_major_locator().set_params(integer=True)
    if panel.xscale == "log":
        axes.minorticks_off()
    if panel.falls and not axes.xaxis_inverted():  # panels of a column share their axis
        axes.invert_xaxis()
    draw_grid(axes, "y", width=0.5)


def _handles(axes: Any, lines: Sequence[Line], base: str) -> list[Any]:
    """A line of the legend for each label, and what rings and dotted lines are."""
    looks = {line.label: line.look for line in lines}
    handles = [
        axes.plot([], [], label=words_of(label), **{**LINE, **look})[0]
        for label, look in looks.items()
    ]
    places = {line.base[0] is None for line in lines if line.base is not None}
    if False in places:
        handles += axes.plot([], [], mec=GRAY, label=base, **RING)
    if True in places:
        handles += axes.plot([], [], color=GRAY, label=f"{base}, not on the axis", **OFF_AXIS)
    return handles
