"""Figures of learning curves, saved as PNG, SVG or PDF."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmdata.drawing.line_labels import label_ends
from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    DATA_LINE,
    PAGE_WIDTH,
    draw_grid,
    figure,
    line_looks,
    line_style,
    thousands,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.results.learning_curves import (
    Curve,
    interval_of,
    read_curve,
)
from swarmdata.rollouts.score_intervals import SHARE, UNBOUNDED


def plot_curves(
    curves: Mapping[str, Curve],
    path: Path,
    *,
    ylabel: str,
    xlabel: str = "gradient updates",
    references: Mapping[str, float] | None = None,
    factor: float = 1.0,
    looks: Looks | None = None,
) -> None:
    """Draws one mean line per label in a band from the lowest to the highest run.

    Labels stand at the ends of their lines.

    Args:
        curves: label -> its runs.
        path: where to save; the suffix is the format.
        ylabel: of the metric, with unit.
        xlabel: of the progress.
        references: label -> height of a dashed line, such as the mean of the dataset.
        factor: from values and references to the unit of the axis: 100 for percentages.
        looks: color and marker of each label; None, or if one is absent: colors in their order.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not curves:
        raise SchemaError("there are no curves to draw, expected at least one.")
    styles = {label: line_style(k) for k, label in enumerate(curves)}
    if looks is not None and set(curves) <= set(looks):
        styles = line_looks({label: looks[label] for label in curves})
    with figure(path, width=COLUMN_WIDTH, height=CURVE_HEIGHT + 0.5) as drawing:
        axes = drawing.add_subplot()
        for label, curve in curves.items():
            values = factor * curve.values
            n_runs = f" ({len(values)} seeds)" if len(values) > 1 else ""
            point = "o" if len(curve.progress) == 1 else None  # a line of one point is invisible
            look = styles[label]
            axes.plot(
                curve.progress, values.mean(0), lw=1.4, marker=point, ms=4, label=label + n_runs,
                **look,
            )  # fmt: skip
            axes.fill_between(
                curve.progress, values.min(0), values.max(0), color=look["color"], alpha=0.18, lw=0
            )
        for label, height in (references or {}).items():
            axes.axhline(factor * height, **DATA_LINE, zorder=1, label=label)
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.xaxis.set_major_formatter(thousands)
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.margins(x=0)
        draw_grid(axes, "y", width=0.5)
        label_ends(axes, axes.get_lines(), CURVE_HEIGHT)


CURVE_HEIGHT = 1.8
"""Inches of a panel of curves."""

METRIC_ROWS = (("success", "team success (%)", 100.0), ("return", "team return", 1.0))
"""Rows of the figure of online learning: column, label with unit, factor to that unit."""


def plot_learning(files: Mapping[str, Mapping[str, Sequence[Path]]], out: Path) -> None:
    """Draws success above and return below, with a column per task and a line per algorithm.

    A line is the mean over runs, its band the 95 % interval for new training seeds on the same
    episodes; its label with the number of runs stands at its end.

    Args:
        files: task -> algorithm -> files with the columns `frames`, `success`, `return` and, if
            a file has several runs, `seed`.
        out: where to save; the suffix is the format.

    Raises:
        SchemaError: there is nothing to draw, a file is malformed, runs of a line were measured at
            different points, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not files or not all(files.values()):
        raise SchemaError("there are no curves to draw, expected at least one file for each task.")
    algorithms = list(dict.fromkeys(name for lines in files.values() for name in lines))
    styles = {name: line_style(k) for k, name in enumerate(algorithms)}
    curves = {  # read before drawing, so that a malformed file leaves no figure
        (task, column): {
            name: read_curve(paths, column, progress="frames") for name, paths in lines.items()
        }
        for task, lines in files.items()
        for column, _, _ in METRIC_ROWS
    }
    width = COLUMN_WIDTH if len(files) == 1 else max(PAGE_WIDTH, 2.3 * len(files))
    with figure(out, width=width, height=2 * CURVE_HEIGHT + 0.9) as drawing:
        grid = drawing.subplots(len(METRIC_ROWS), len(files), squeeze=False, sharex="col")
        for axes, task in zip(grid[0], files, strict=True):
            axes.set_title(task, fontweight="bold", loc="left")
        for row, (column, ylabel, factor) in zip(grid, METRIC_ROWS, strict=True):
            for axes, task in zip(row, files, strict=True):
                _draw_panel(axes, curves[task, column], styles, factor, is_share=factor != 1.0)
                axes.xaxis.set_major_formatter(thousands)
            row[0].set_ylabel(ylabel)
        for axes in grid[-1]:
            axes.set_xlabel("joint steps of training")
        for axes in grid.ravel():
            label_ends(axes, axes.get_lines(), CURVE_HEIGHT)


def _draw_panel(
    axes: Any,
    lines: Mapping[str, Curve],
    styles: Mapping[str, Mapping[str, Any]],
    factor: float,
    *,
    is_share: bool,
) -> None:
    for name, curve in lines.items():
        low, high = interval_of(curve, SHARE if is_share else UNBOUNDED)
        if len(curve.values) > 1:
            axes.fill_between(
                curve.progress,
                factor * low,
                factor * high,
                alpha=0.18,
                lw=0,
                color=styles[name]["color"],
            )
        n_runs = len(curve.values)
        label = f"{name} ({n_runs} {'run' if n_runs == 1 else 'runs'})"
        mean = factor * curve.values.mean(axis=0)
        axes.plot(curve.progress, mean, lw=1.4, label=label, **styles[name])
    axes.margins(x=0)
    if is_share:
        axes.set_ylim(-2.0, 102.0)
    draw_grid(axes, "y", width=0.5)
