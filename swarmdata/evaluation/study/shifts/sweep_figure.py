"""The figure of a study's sweeps: success and clean success along every axis."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    GRAY,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    figure,
    line_looks,
    words_of,
)
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.robustness.sweep_plots import AXIS_LABELS
from swarmdata.evaluation.study.shifts.sweep_files import CLEAN, SUCCESS, SweptAxis

RING = {"marker": "o", "mfc": "white", "mew": 1.2, "ms": 4.5, "ls": ""}
"""Around the value of training."""

OFF_AXIS = {"lw": 1.0, "ls": (0, (1, 2))}
"""Result of training where its value, such as unlimited bandwidth, has no place on the axis."""


def plot_sweeps(sweeps: Sequence[SweptAxis], looks: Looks, path: Path) -> None:
    """Draws a column for each sweep; worse values are on the right.

    Args:
        sweeps: at least one.
        looks: color and marker of each row of the study.
        path: where to save.
    """
    lines = line_looks(looks)
    styles = {label: {**looks[label], **lines[label]} for label in looks}
    quantities = (SUCCESS.column, CLEAN.column)
    width = COLUMN_WIDTH if len(sweeps) == 1 else PAGE_WIDTH
    with figure(path, width=width, height=3.8) as drawing:
        grid = drawing.subplots(2, len(sweeps), squeeze=False, sharey=True, sharex="col")
        for column, sweep in enumerate(sweeps):
            for axes, quantity in zip(grid[:, column], quantities, strict=True):
                _draw_panel(axes, sweep, quantity, styles)
            first = sweep.rows[0]
            label = AXIS_LABELS.get((first["part"], first["parameter"]), sweep.name)
            grid[1, column].set_xlabel(label.replace(" (", "\n(").replace(" of ", "\nof ", 1))
            values = [float(row["value"]) for row in sweep.rows if row["value"]]
            if values[-1] < values[0]:
                grid[0, column].invert_xaxis()
        for axes, quantity in zip(grid[:, 0], quantities, strict=True):
            axes.set_ylabel(quantity.header)
            axes.set_ylim(-4.0, 104.0)
        labels = list(dict.fromkeys(row["policy"] for sweep in sweeps for row in sweep.rows))
        axes = grid[0, 0]
        handles = [axes.plot([], [], ms=3, label=words_of(name), **styles[name])[0]
                   for name in labels]  # fmt: skip
        handles += axes.plot([], [], mec=GRAY, label="as trained", **RING)
        if any(not row["value"] for sweep in sweeps for row in sweep.rows):
            handles += axes.plot(
                [], [], color=GRAY, label="as trained, not on the axis", **OFF_AXIS
            )
        draw_legend(drawing, handles)


def _draw_panel(axes: Any, sweep: SweptAxis, column: Column, styles: Looks) -> None:
    for label in dict.fromkeys(row["policy"] for row in sweep.rows):
        look = styles[label]
        rows = [row for row in sweep.rows if row["policy"] == label and row["metric"] == column.key]
        points = {
            float(row["value"]): [
                column.factor * float(row[k]) for k in ("estimate", "low", "high")
            ]
            for row in rows
            if row["value"]
        }
        mean, low, high = zip(*points.values(), strict=True)
        axes.fill_between(list(points), low, high, color=look["color"], alpha=0.13, lw=0)
        axes.plot(list(points), mean, lw=1.3, ms=3, **look)
        (trained,) = (row for row in rows if row["as_trained"] == "1")
        height = column.factor * float(trained["estimate"])
        if trained["value"]:
            axes.plot([float(trained["value"])], [height], mec=look["color"], zorder=4, **RING)
        else:
            axes.axhline(height, color=look["color"], zorder=1, **OFF_AXIS)
    draw_grid(axes, "y", width=0.5)
