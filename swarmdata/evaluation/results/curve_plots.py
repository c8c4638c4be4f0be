"""Figures of learning curves, saved as PNG, SVG or PDF."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import GRAY, colors, draw_grid, figure, thousands
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.learning_curves import (
    Curve,
    GroupedFiles,
    group_files,
    interval_of,
    read_curve,
)
from swarmdata.types import Double


def plot_curves(
    curves: Mapping[str, Curve],
    path: Path,
    *,
    ylabel: str,
    xlabel: str = "gradient updates",
    references: Mapping[str, float] | None = None,
    factor: float = 1.0,
) -> None:
    """Draws one mean line per label in a band from the lowest to the highest run.

    Args:
        curves: label -> its runs.
        path: where to save; the suffix is the format.
        ylabel: of the metric, with unit.
        xlabel: of the progress.
        references: label -> height of a dashed line, such as the mean of the dataset.
        factor: from values and references to the unit of the axis: 100 for percentages.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not curves:
        raise SchemaError("there are no curves to draw, expected at least one.")
    with figure(path, width=6.4, height=3.8) as drawing:
        axes = drawing.add_subplot()
        for (label, curve), color in zip(curves.items(), colors(len(curves)), strict=True):
            values = factor * curve.values
            n_runs = f" ({len(values)} seeds)" if len(values) > 1 else ""
            point = "o" if len(curve.progress) == 1 else None  # a line of one point is invisible
            axes.plot(
                curve.progress,
                values.mean(0),
                color=color,
                lw=1.8,
                marker=point,
                label=label + n_runs,
            )
            axes.fill_between(
                curve.progress, values.min(0), values.max(0), color=color, alpha=0.18, lw=0
            )
        for label, height in (references or {}).items():
            axes.axhline(factor * height, color=GRAY, lw=1, ls=(0, (4, 3)), zorder=1, label=label)
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.xaxis.set_major_formatter(thousands)
        axes.margins(x=0)
        draw_grid(axes, "y")
        _label_ends(axes)


METRIC_ROWS = (("success", "team success (%)", 100.0), ("return", "team return", 1.0))
"""Rows of the figure of online learning: column, label with unit, factor to that unit."""


MIN_LABEL_GAP = 0.075
"""Between labels at the ends of lines, as a share of the axes' height."""


def plot_learning(files: GroupedFiles, out: Path, *, log: bool = False) -> None:
    """Draws success above and return below, with a column per task and a line per algorithm.

    A line is the mean over runs, its band the 95 % interval for new training seeds on the same
    episodes; its label with the number of runs stands at its end.

    Args:
        files: task -> algorithm -> files with the columns `frames`, `success`, `return` and, if
            a file has several runs, `seed`.
        out: where to save; the suffix is the format.
        log: whether the axis of joint steps is logarithmic.

    Raises:
        SchemaError: there is nothing to draw, a file is malformed, runs of a line were measured at
            different points, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not files or not all(files.values()):
        raise SchemaError("there are no curves to draw, expected at least one file for each task.")
    algorithms = list(dict.fromkeys(name for lines in files.values() for name in lines))
    color_of = dict(zip(algorithms, colors(len(algorithms)), strict=True))
    curves = {  # read before drawing, so that a malformed file leaves no figure
        (task, column): {
            name: read_curve(paths, column, progress="frames") for name, paths in lines.items()
        }
        for task, lines in files.items()
        for column, _, _ in METRIC_ROWS
    }
    with figure(out, width=0.9 + 3.9 * len(files), height=5.6) as drawing:
        grid = drawing.subplots(len(METRIC_ROWS), len(files), squeeze=False, sharex="col")
        for axes, task in zip(grid[0], files, strict=True):
            axes.set_title(task, fontweight="bold", loc="left")
        for row, (column, ylabel, factor) in zip(grid, METRIC_ROWS, strict=True):
            for axes, task in zip(row, files, strict=True):
                _draw_panel(axes, curves[task, column], color_of, factor, is_share=factor != 1.0)
                if log:
                    axes.set_xscale("log")
                    axes.minorticks_off()
                axes.xaxis.set_major_formatter(thousands)
            row[0].set_ylabel(ylabel)
        for axes in grid[-1]:
            axes.set_xlabel("joint steps of training")
        for axes in grid.ravel():
            _label_ends(axes)


def _draw_panel(
    axes: Any,
    lines: Mapping[str, Curve],
    color_of: Mapping[str, str],
    factor: float,
    *,
    is_share: bool,
) -> None:
    for name, curve in lines.items():
        low, high = interval_of(curve)
        if len(curve.values) > 1:
            axes.fill_between(
                curve.progress, factor * low, factor * high, color=color_of[name], alpha=0.18, lw=0
            )
        n_runs = len(curve.values)
        label = f"{name} ({n_runs} {'run' if n_runs == 1 else 'runs'})"
        mean = factor * curve.values.mean(axis=0)
        axes.plot(curve.progress, mean, color=color_of[name], lw=1.8, label=label)
    axes.margins(x=0)
    if is_share:
        axes.set_ylim(-2.0, 102.0)
    draw_grid(axes, "y")


def _label_ends(axes: Any) -> None:
    """Writes each line's label at its end, without overlaps."""
    low, high = axes.get_ylim()
    lines = axes.get_lines()
    wanted = np.array([(line.get_ydata()[-1] - low) / (high - low) for line in lines])
    for line, place in zip(lines, spread_labels(wanted, MIN_LABEL_GAP), strict=True):
        axes.annotate(
            line.get_label(),
            (1.0, place),
            xycoords="axes fraction",
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=line.get_color(),
            annotation_clip=False,
        )


def spread_labels(wanted: Double, gap: float) -> Double:
    """Places labels at least `gap` apart, in their order and as near to `wanted` as possible.

    Isotonic regression by least squares: without the gaps the places must not decrease, which
    pooling adjacent violators solves (Barlow, Bartholomew, Bremner and Brunk, "Statistical
    Inference under Order Restrictions", 1972, section 1.2). The labels stay within [0, 1] if
    they fit.
    """
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []  # mean and number of the labels in a block
    for value in (wanted[order] - steps).tolist():
        mean, n = value, 1
        while blocks and blocks[-1][0] > mean:
            before, m = blocks.pop()
            mean, n = (before * m + mean * n) / (m + n), m + n
        blocks.append((mean, n))
    level = np.repeat([mean for mean, _ in blocks], [n for _, n in blocks])
    places = np.empty(len(wanted))
    places[order] = np.clip(level, 0.0, max(0.0, 1.0 - steps[-1])) + steps
    return places


def draw_training(files: Sequence[Path], metric: str, out: Path) -> None:
    """Draws the learning curves of online runs, one line for each file.

    Args:
        files: copies of `curve.csv`, whose stems become labels.
        metric: column to draw; a share in [0, 1] unless it is `return`.
        out: where to save; the suffix is the format.
    """
    curves = {file.stem: read_curve([file], metric, progress="frames") for file in files}
    is_return = metric == "return"
    plot_curves(
        curves,
        out,
        ylabel="team return" if is_return else f"{metric.replace('_', ' ')} (%)",
        xlabel="joint steps of training",
        factor=1.0 if is_return else 100.0,
    )


def draw_learning(files: Sequence[Path], by: str, out: Path, *, log: bool = False) -> None:
    """Draws success and return of online runs by task and algorithm.

    Args:
        files: CSV files as `plot_learning` takes them.
        by: how the files are named, as `group_files` takes it.
        out: where to save; the suffix is the format.
        log: whether the axis of joint steps is logarithmic.
    """
    plot_learning(group_files(files, by), out, log=log)
