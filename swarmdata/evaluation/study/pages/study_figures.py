"""The figures of a study that only it has: training curves.

A label has the same color and marker in all figures: the color of its family, a marker of its own.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarmdata.drawing.line_labels import label_ends
from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    PAGE_WIDTH,
    draw_grid,
    figure,
    line_looks,
    thousands,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.results.learning_curves import Curve

MARKED_POINTS = 6
"""Markers on a training curve, at most about."""

CURVE_PANEL_HEIGHT = 1.45
"""Inches."""


def plot_training_curves(
    panels: Mapping[str, Mapping[str, Curve]],
    looks: Looks,
    path: Path,
    *,
    ylabel: str,
    factor: float = 1.0,
    is_log: bool = False,
    n_columns: int = 3,
    xlabel: str = "gradient updates",
) -> None:
    """Draws values over training: the mean over seeds in a band from lowest to highest.

    Panels share the vertical axis; labels stand at the ends of their lines.

    Args:
        panels: title -> algorithm -> curve.
        looks: color and marker of each algorithm.
        path: where to save.
        ylabel: of the values, with unit.
        factor: from values to that unit.
        is_log: whether the vertical axis is symmetric logarithmic: linear from -2 to 2.
        n_columns: panels in a row, at most.
        xlabel: of the progress of training.
    """
    if not panels:
        raise SchemaError("there are no curves to draw, expected at least one dataset.")
    n_columns = min(n_columns, len(panels))
    n_rows = math.ceil(len(panels) / n_columns)
    width = COLUMN_WIDTH if n_columns == 1 else max(PAGE_WIDTH, 2.1 * n_columns)
    lines = line_looks(looks)
    with figure(path, width=width, height=0.5 + (CURVE_PANEL_HEIGHT + 0.35) * n_rows) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False, sharey=True).ravel()
        for axes, (title, curves) in zip(grid, panels.items(), strict=False):
            for name, curve in curves.items():
                look = {**looks[name], **lines[name]}
                _draw_band(axes, curve, factor, name, look)
            axes.set_yscale("symlog" if is_log else "linear")
            axes.xaxis.set_major_formatter(thousands)
            axes.margins(x=0)
            set_up_panel(axes, title)
        for axes in grid[: len(panels)]:  # all lines are drawn, so the shared limits are final
            label_ends(axes, axes.get_lines(), CURVE_PANEL_HEIGHT)
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        drawing.supxlabel(xlabel, fontsize=8)
        drawing.supylabel(ylabel, fontsize=8)


def _draw_band(axes: Any, curve: Curve, factor: float, label: str, look: Mapping[str, Any]) -> None:
    values = factor * curve.values
    every = max(1, len(curve.progress) // MARKED_POINTS)
    axes.plot(curve.progress, values.mean(0), lw=1.3, ms=3, markevery=every, label=label, **look)
    low, high = values.min(0), values.max(0)
    axes.fill_between(curve.progress, low, high, color=look["color"], alpha=0.13, lw=0)


def set_up_panel(axes: Any, title: str) -> None:
    """Gives a panel its title, with the models of a condition below its task, and a grid."""
    axes.set_title(title.replace("~", "\n"), loc="left", fontsize=7.5, fontweight="bold")
    draw_grid(axes, width=0.5)
