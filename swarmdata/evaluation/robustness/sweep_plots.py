"""The figure of a robustness sweep: what a team loses along one axis, a panel for each metric."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import COLORS, DASHES, GRAY, draw_grid, figure, line_style
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.robustness.sweep_tables import Degradation, Line, Point
from swarmdata.types import Double

PANELS = ("success", "clean_success", "time_to_goal", "robot_collisions", "obstacle_collisions")
"""Columns that are drawn, after the score or, without one, the return."""

AXES: Mapping[tuple[str, str], str] = {
    ("communication", "drop"): "share of messages lost",
    ("communication", "drop_probability"): "share of messages lost",
    ("communication", "delay"): "delay of messages (steps)",
    ("communication", "range"): "range of the radio (m)",
    ("communication", "bandwidth"): "messages heard per step",
    ("communication", "messages_per_step"): "messages heard per step",
    ("communication", "bits"): "bits of each value sent",
    ("observation", "noise"): "sensor noise (m, m/s, rad)",
    ("observation", "noise.position"): "noise of positions (m)",
    ("observation", "noise.velocity"): "noise of velocities (m/s)",
    ("observation", "noise.direction"): "noise of directions (rad)",
    ("observation", "noise.range"): "noise of ranges (m)",
    ("observation", "range"): "range of sight (m)",
    ("observation", "limit"): "range of sight (m)",
    ("observation", "dropout"): "share of returns lost",
    ("observation", "delay"): "delay of what is seen (steps)",
}
"""What the horizontal axis says; another parameter is shown by its name."""


def plot_degradation(found: Degradation, out: Path) -> None:
    """Draws one axis of a sweep: lines with 95 % bands, a ring where all is as in training.

    A team whose training has no place on the axis, such as unlimited bandwidth, has a dotted line
    at what it achieved then. The axis runs as it was written, so that worse may be on the right.

    Args:
        found: what to draw.
        out: where to save; the suffix is the format.

    Raises:
        SchemaError: nothing to draw, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    if not found.lines or not all(line.on_axis for line in found.lines):
        raise SchemaError("a line of the sweep has no points, expected at least one for each.")
    n_styles = len(COLORS) * len(DASHES)
    if len(found.lines) > n_styles:
        raise SchemaError(
            f"got {len(found.lines)} policies, but one figure can distinguish only {n_styles}. "
            "Sweep fewer at once."
        )
    first = "score" if "score" in [column.key for column in found.columns] else "return"
    xlabel = AXES.get((found.part, found.name), f"{found.part} {found.name}")
    with figure(out, width=8.6, height=5.2) as drawing:
        grid = drawing.subplots(2, 3, sharex=True)
        for axes, key in zip(grid.ravel(), (first, *PANELS), strict=True):
            index = found.column(key)
            for k, line in enumerate(found.lines):
                _draw(axes, line, index, found.columns[index], line_style(k))
            _frame(axes, found.columns[index])
        if found.falls:
            grid[0, 0].invert_xaxis()
        for axes in grid[-1]:
            axes.set_xlabel(xlabel)
        _legend(drawing, grid[0, 0], found)


def _draw(axes: Any, line: Line, index: int, column: Column, style: Mapping[str, Any]) -> None:
    color = style["color"]
    at = np.array([point.value for point in line.on_axis], np.float64)
    mean, low, high = _shown(line.on_axis, index, column)
    axes.fill_between(at, low, high, color=color, alpha=0.16, lw=0)
    label = f"{line.label} ({line.n_runs} seeds)" if line.n_runs > 1 else line.label
    axes.plot(at, mean, lw=1.8, marker="o", ms=3.5, label=label, **style)
    before = line.trained
    ((height,), *_) = _shown((before,), index, column)
    if before.value is None:
        axes.axhline(height, color=color, lw=1.1, ls=(0, (1, 2)), zorder=1)
    else:
        ring = {"mfc": "white", "mec": color, "mew": 1.6, "ms": 7, "zorder": 4}
        axes.plot([before.value], [height], "o", **ring)


def _shown(points: tuple[Point, ...], index: int, column: Column) -> Double:
    """Estimates and ends of their intervals in the shown unit, [3, P]."""
    return column.factor * np.array([point.estimates[index] for point in points]).T


def _frame(axes: Any, column: Column) -> None:
    axes.set_title(column.header, loc="left", fontsize=10)
    if column.is_rate:
        axes.set_ylim(-4.0, 104.0)  # room for markers at the ends
    elif column.key != "return":  # 0 is always seen, with room for a marker at the top
        low, high = axes.get_ylim()
        low, high = min(0.0, low), max(0.0, high)
        axes.set_ylim(low, high + 0.05 * (high - low))
    draw_grid(axes, "y")


def _legend(drawing: Any, axes: Any, found: Degradation) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415  (matplotlib is an extra)

    handles, labels = axes.get_legend_handles_labels()
    on_axis = [line.trained.value is not None for line in found.lines]
    if any(on_axis):
        handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec=GRAY, mew=1.6, ms=7))
        labels.append("as trained")
    if not all(on_axis):
        handles.append(Line2D([], [], color=GRAY, lw=1.1, ls=(0, (1, 2))))
        labels.append("as trained, not on the axis")
    drawing.legend(handles, labels, loc="outside upper center", ncols=min(4, len(handles)))
