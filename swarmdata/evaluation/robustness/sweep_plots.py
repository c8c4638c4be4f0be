"""The figure of a robustness sweep: metrics of teams along one axis, a panel for each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import COLORS, DASHES, line_style
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.line_plot import Line, LinePanel, plot_lines
from swarmdata.evaluation.robustness.sweep_tables import Degradation

PANEL_HEIGHT = 1.5  # inches

PANEL_COLUMNS = (
    "success", "clean_success", "time_to_goal", "robot_collisions", "obstacle_collisions",
)  # fmt: skip
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


def plot_degradation(found: Degradation, out: Path) -> None:
    """Draws one axis of a sweep: lines with 95 % bands, and a ring at the value of training.

    If the value of training is not on the axis, such as unlimited bandwidth, a dotted line shows
    its result. The axis runs in the order of its values, so that worse ones may be on the right.
    """
    n_styles = len(COLORS) * len(DASHES)
    if len(found.lines) > n_styles:
        raise SchemaError(
            f"got {len(found.lines)} policies, but one figure can distinguish only {n_styles}. "
            "Sweep fewer at once."
        )
    styles = {line.label: {**line_style(k), "marker": "o"} for k, line in enumerate(found.lines)}
    names = {
        line.label: f"{line.label} ({line.n_runs} seeds)" for line in found.lines if line.n_runs > 1
    }
    first = "score" if "score" in [column.key for column in found.columns] else "return"
    panels = [degradation_panel(found, key, styles, names) for key in (first, *PANEL_COLUMNS)]
    below = [panel._replace(xlabel=axis_label(found)) for panel in panels[3:]]
    plot_lines([panels[:3], below], out, height=PANEL_HEIGHT, shares_x=True, base=found.base)


def axis_label(found: Degradation) -> str:
    """What the axis of a sweep is called in figures."""
    return AXIS_LABELS.get((found.part, found.name), f"{found.part} {found.name}")


def degradation_panel(
    found: Degradation,
    key: str,
    styles: Mapping[str, Mapping[str, Any]],
    names: Mapping[str, str] = {},
) -> LinePanel:
    """One quantity of all teams along the axis; `names` are those in the legend, if not labels."""
    index = found.column(key)
    column, lines = found.columns[index], []
    for line in found.lines:
        x = np.array([point.value for point in line.on_axis], np.float64)
        ends = column.factor * np.array([point.estimates[index] for point in line.on_axis]).T
        height = column.factor * line.trained.estimates[index].value
        label = names.get(line.label, line.label)
        lines.append(Line(label, x, ends, styles[line.label], (line.trained.value, height)))
    limits = None
    if column.is_rate:
        limits = (-4.0, 104.0)  # room for markers at the ends
    elif column.key != "return":  # always shows 0, with room for a marker at the top
        every = [0.0, *(end for line in lines for end in line.ends.ravel().tolist())]
        low, high = float(np.nanmin(every)), float(np.nanmax(every))
        margin = 0.05 * (high - low) or 0.5
        limits = low - margin * (low < 0.0), high + margin
    return LinePanel(column.header, lines, limits=limits, falls=found.falls)
