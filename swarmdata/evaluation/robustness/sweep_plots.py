"""The figure of a robustness sweep: metrics of teams along one axis, a panel for each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import (
    COLORS,
    DASHES,
    GRAY,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    figure,
    line_looks,
    line_style,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.robustness.sweep_tables import Degradation, Line, Point
from swarmdata.types import Double

PANEL_COLUMNS = (
    "success",
    "clean_success",
    "time_to_goal",
    "robot_collisions",
    "obstacle_collisions",
)
"""Columns that are drawn after the score or, without one, the return."""

AXIS_LABELS: Mapping[tuple[str, str], str] = {
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
    ("observation", "drift"): "drift of odometry (m/m, rad/m, rad/rad)",
    ("observation", "drift.position"): "drift of positions (m/m)",
    ("observation", "drift.heading"): "drift of headings (rad/m)",
    ("observation", "drift.turning"): "drift of turns (rad/rad)",
    ("observation", "landmarks"): "range of landmarks (m)",
    ("observation", "range"): "range of sight (m)",
    ("observation", "limit"): "range of sight (m)",
    ("observation", "dropout"): "share of returns lost",
    ("observation", "delay"): "delay of observations (steps)",
    ("body", "max_speed"): "largest speed (m/s)",
    ("body", "max_acceleration"): "largest acceleration (m/s\u00b2)",
    ("body", "max_turn_rate"): "largest turn rate (rad/s)",
    ("body", "command_delay"): "delay of commands (steps)",
    ("body", "actuator_lag"): "time constant of the motors (s)",
    ("body", "mass"): "mass of the robots (kg)",
    ("body", "friction"): "friction coefficient of the robots",
    ("body", "wheel_grip"): "grip of the wheels (m/s\u00b2)",
    ("body", "payload_mass"): "mass of the payload (kg)",
    ("body", "payload_friction"): "friction of the payload (N)",
}
"""Of the horizontal axis; other parameters are shown by their names."""


def plot_degradation(found: Degradation, out: Path, looks: Looks | None = None) -> None:
    """Draws one axis of a sweep: lines with 95 % bands, and a ring at the value of training.

    If the value of training is not on the axis, such as unlimited bandwidth, a dotted line shows
    its result. The axis runs in the order of its values, so that worse ones may be on the right.

    Args:
        found: sweep to draw.
        out: where to save; the suffix is the format.
        looks: color and marker of each line's label; None: colors in the order of the lines.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
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
    xlabel = AXIS_LABELS.get((found.part, found.name), f"{found.part} {found.name}")
    styles = {line.label: line_style(k) for k, line in enumerate(found.lines)}
    if looks is not None:
        styles = line_looks({label: looks[label] for label in styles})
    with figure(out, width=PAGE_WIDTH, height=4.2) as drawing:
        grid = drawing.subplots(2, 3, sharex=True)
        for axes, key in zip(grid.ravel(), (first, *PANEL_COLUMNS), strict=True):
            index = found.column(key)
            for line in found.lines:
                _draw(axes, line, index, found.columns[index], styles[line.label])
            _set_limits(axes, found.columns[index])
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
    axes.plot(at, mean, lw=1.3, marker="o", ms=3, label=label, **style)
    before = line.trained
    ((height,), *_) = _shown((before,), index, column)
    if before.value is None:
        axes.axhline(height, color=color, lw=1.1, ls=(0, (1, 2)), zorder=1)
    else:
        ring = {"mfc": "white", "mec": color, "mew": 1.2, "ms": 5, "zorder": 4}
        axes.plot([before.value], [height], "o", **ring)


def _shown(points: tuple[Point, ...], index: int, column: Column) -> Double:
    """Estimates and their intervals in the shown unit, [3, P]."""
    return column.factor * np.array([point.estimates[index] for point in points]).T


def _set_limits(axes: Any, column: Column) -> None:
    """Titles a panel and limits its vertical axis."""
    axes.set_title(column.header, loc="left", fontweight="bold", fontsize=7.5)
    if column.is_rate:
        axes.set_ylim(-4.0, 104.0)  # room for markers at the ends
    elif column.key != "return":  # always shows 0, with room for a marker at the top
        low, high = axes.get_ylim()
        low, high = min(0.0, low), max(0.0, high)
        axes.set_ylim(low, high + 0.05 * (high - low))
    draw_grid(axes, "y", width=0.5)


def _legend(drawing: Any, axes: Any, found: Degradation) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415  (matplotlib is an extra)

    handles, _ = axes.get_legend_handles_labels()
    on_axis = [line.trained.value is not None for line in found.lines]
    if any(on_axis):
        ring: dict[str, Any] = {"marker": "o", "mfc": "white", "mec": GRAY, "mew": 1.2, "ms": 5}
        handles.append(Line2D([], [], ls="", label=found.base, **ring))
    if not all(on_axis):
        words = f"{found.base}, not on the axis"
        handles.append(Line2D([], [], color=GRAY, lw=1.1, ls=(0, (1, 2)), label=words))
    draw_legend(drawing, handles)
