"""The figures of a study: scores, estimates against others, data efficiency, training curves.

A label has the same color and marker in all of them: the color of its family, a marker of its own.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmdata.drawing.style import (
    DATA_LINE,
    draw_grid,
    figure,
    thousands,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.learning_curves import Curve
from swarmdata.rollouts.score_statistics import Estimate

MAX_LINES_IN_ONE_LEGEND = 6
"""Up to this number of labels in total, all panels share one legend."""

MARKED_POINTS = 6
"""Markers on a training curve, at most about."""

Estimates = Mapping[str, Estimate]
Looks = Mapping[str, Mapping[str, str]]
"""Color and marker of each label, as of `family_looks`."""


def plot_scores(
    panels: Mapping[str, Estimates],
    data: Mapping[str, float],
    families: Mapping[str, str],
    looks: Looks,
    path: Path,
    *,
    label: str,
) -> None:
    """Draws a row for each algorithm and a panel for each dataset, with the mean of the data.

    Args:
        panels: dataset -> algorithm -> estimate; an algorithm may be absent.
        data: dataset -> mean of its own episodes, where it is known.
        families: algorithm -> family, the first one on top.
        looks: color and marker of each algorithm.
        path: where to save.
        label: of the horizontal axis.

    Raises:
        SchemaError: there is nothing to draw.
    """
    _check_not_empty(panels, "scores")
    n_columns = min(4, len(panels))
    n_rows = math.ceil(len(panels) / n_columns)
    height = n_rows * (0.75 + 0.21 * len(families)) + 0.4
    with figure(path, width=1.5 + 2.35 * n_columns, height=height) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False, sharey=True).ravel()
        for axes, (dataset, estimates) in zip(grid, panels.items(), strict=False):
            for y, name in enumerate(families):
                if name in estimates:
                    _draw_interval(axes, estimates[name], y, looks[name])
            if dataset in data:
                axes.axvline(data[dataset], **DATA_LINE, zorder=0)
            _set_up_panel(axes, dataset)
            axes.tick_params(axis="y", length=0, labelsize=8)
        _hide_unused(grid[len(panels) :])
        grid[0].set_yticks(range(len(families)), families)
        grid[0].set_ylim(len(families) - 0.5, -0.5)
        drawing.supxlabel(label, fontsize=10)
        colors = {family: looks[name]["color"] for name, family in families.items()}
        _family_legend(drawing, grid[0], colors, has_data=bool(data))


def _check_not_empty(panels: Mapping[str, object], what: str) -> None:
    if not panels:
        raise SchemaError(f"there are no {what} to draw, expected at least one dataset.")


def _draw_interval(axes: Any, estimate: Estimate, y: int, look: Mapping[str, str]) -> None:
    axes.plot([estimate.low, estimate.high], [y, y], color=look["color"], lw=2.2, alpha=0.55)
    axes.plot([estimate.value], [y], ls="none", ms=5, **look)


def _family_legend(drawing: Any, axes: Any, colors: Mapping[str, str], *, has_data: bool) -> None:
    handles = [
        axes.plot([], [], "o", color=color, ms=5, label=kind or "algorithms")[0]
        for kind, color in colors.items()
    ]
    if has_data:
        handles += axes.plot([], [], **DATA_LINE, label="mean of the data")
    _legend_above(drawing, handles)


def plot_two_estimates(
    panels: Mapping[str, Mapping[str, tuple[Estimate, Estimate]]],
    looks: Looks,
    path: Path,
    *,
    xlabel: str,
    ylabel: str,
    xlim: tuple[float, float],
) -> None:
    """Draws one estimate against another, a panel for each dataset.

    Args:
        panels: dataset -> algorithm -> (horizontal, vertical) in shown units.
        looks: color and marker of each algorithm.
        path: where to save.
        xlabel: of the horizontal axis.
        ylabel: of the vertical axis.
        xlim: ends of the horizontal axis.
    """
    _check_not_empty(panels, "points")
    n_columns = min(4, len(panels))
    n_rows = math.ceil(len(panels) / n_columns)
    shown = [name for name in looks if any(name in points for points in panels.values())]
    height = max(0.6 + 2.3 * n_rows, 0.2 + 0.19 * len(shown))  # of the panels, of the legend
    with figure(path, width=2.0 + 2.45 * n_columns, height=height) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False).ravel()
        for axes, (dataset, points) in zip(grid, panels.items(), strict=False):
            for name, (x, y) in points.items():
                _draw_cross(axes, x, y, looks[name])
            axes.set_xlim(*xlim)
            _set_up_panel(axes, dataset)
        _hide_unused(grid[len(panels) :])
        drawing.supxlabel(xlabel, fontsize=10)
        drawing.supylabel(ylabel, fontsize=10)
        handles = [
            grid[0].plot([], [], ls="none", ms=5, label=name, **looks[name])[0] for name in shown
        ]
        drawing.legend(handles=handles, loc="outside right center", fontsize=8)


def _draw_cross(
    axes: Any, x: Estimate, y: Estimate, look: Mapping[str, str], face: str | None = None
) -> None:
    """Draws a point with both intervals; `face` fills it, None: the color of its look."""
    axes.plot([x.low, x.high], [y.value] * 2, color=look["color"], lw=1.2, alpha=0.5)
    axes.plot([x.value] * 2, [y.low, y.high], color=look["color"], lw=1.2, alpha=0.5)
    axes.plot([x.value], [y.value], ls="none", ms=5, mfc=face or look["color"], **look)


def plot_fronts(
    panels: Mapping[str, Sequence[tuple[str, Mapping[str, tuple[Estimate, Estimate]]]]],
    fronts: Mapping[str, Sequence[Collection[str]]],
    looks: Looks,
    path: Path,
    *,
    ylabel: str,
) -> None:
    """Draws one estimate against several others: a row for each dataset, a panel for each other.

    Args:
        panels: dataset -> (horizontal axis, label -> (horizontal, vertical)) of each panel.
        fronts: dataset -> Pareto-optimal labels of each panel, whose points are filled.
        looks: color and marker of each label.
        path: where to save.
        ylabel: of the vertical axes.
    """
    _check_not_empty(panels, "points")
    n_columns = len(next(iter(panels.values())))
    shown = [k for k in looks if any(k in points for row in panels.values() for _, points in row)]
    height = max(0.5 + 2.5 * len(panels), 0.3 + 0.19 * len(shown))  # of the panels, of the legend
    with figure(path, width=2.2 + 3.1 * n_columns, height=height) as drawing:
        grid = drawing.subplots(len(panels), n_columns, squeeze=False, sharey="row")
        for line, (dataset, row) in zip(grid, panels.items(), strict=True):
            for axes, (xlabel, points), front in zip(line, row, fronts[dataset], strict=True):
                for name, (x, y) in points.items():
                    face = looks[name]["color"] if name in front else "white"
                    _draw_cross(axes, x, y, looks[name], face)
                _set_up_panel(axes, dataset)
                axes.set_xlabel(xlabel)
            line[0].set_ylabel(ylabel)
        handles = [
            grid[0, 0].plot([], [], ls="none", ms=5, label=name, **looks[name])[0] for name in shown
        ]
        drawing.legend(handles=handles, loc="outside right center", fontsize=8)


def plot_sizes(
    panels: Mapping[str, Mapping[str, Mapping[int, Estimate]]],
    data: Mapping[str, Mapping[int, float]],
    looks: Looks,
    path: Path,
    *,
    ylabel: str,
) -> None:
    """Draws an estimate over the number of joint steps, a panel for each dataset.

    Args:
        panels: dataset -> algorithm -> joint steps -> estimate.
        data: dataset -> joint steps -> mean of those episodes.
        looks: color and marker of each algorithm.
        path: where to save.
        ylabel: of the estimate.
    """
    _check_not_empty(panels, "sizes")
    with figure(path, width=1.6 + 2.7 * len(panels), height=3.6) as drawing:
        grid = drawing.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axes, (dataset, lines) in zip(grid, panels.items(), strict=True):
            for name, points in lines.items():
                steps, look = sorted(points), looks[name]
                found = [points[step] for step in steps]
                axes.plot(steps, [e.value for e in found], ms=5, lw=1.6, label=name, **look)
                axes.fill_between(
                    steps, [e.low for e in found], [e.high for e in found],
                    color=look["color"], alpha=0.13, lw=0,
                )  # fmt: skip
            means = data.get(dataset, {})
            sizes = sorted(means or {n for each in lines.values() for n in each})
            if means:
                values = [means[n] for n in sizes]
                axes.plot(sizes, values, **DATA_LINE, label="mean of the data")
            axes.set_xscale("log")
            axes.set_xticks(sizes)
            axes.set_xticks([], minor=True)
            axes.xaxis.set_major_formatter(_rounded_thousands)
            _set_up_panel(axes, dataset)
        drawing.supxlabel("joint steps of data", fontsize=10)
        grid[0].set_ylabel(ylabel)
        _legend_above(drawing, _legend_handles(grid))


def plot_training_curves(
    panels: Mapping[str, Mapping[str, Curve]],
    looks: Looks,
    path: Path,
    *,
    ylabel: str,
    factor: float = 1.0,
    is_log: bool = False,
    n_columns: int = 3,
) -> None:
    """Draws values over gradient updates: the mean over seeds in a band from lowest to highest.

    Few labels share one legend; of many, each panel has its own.

    Args:
        panels: title -> algorithm -> curve.
        looks: color and marker of each algorithm.
        path: where to save.
        ylabel: of the values, with unit.
        factor: from values to that unit.
        is_log: whether the vertical axis is symmetric logarithmic: linear from -2 to 2.
        n_columns: panels in a row, at most.
    """
    _check_not_empty(panels, "curves")
    labels = list(dict.fromkeys(name for each in panels.values() for name in each))
    is_shared = len(labels) <= MAX_LINES_IN_ONE_LEGEND
    n_columns = min(n_columns, len(panels))
    n_rows = math.ceil(len(panels) / n_columns)
    with figure(path, width=1.2 + 3.0 * n_columns, height=0.9 + 2.5 * n_rows) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False).ravel()
        for axes, (title, curves) in zip(grid, panels.items(), strict=False):
            for name, curve in curves.items():
                _draw_band(axes, curve, factor, name, looks[name])
            axes.set_yscale("symlog" if is_log else "linear")
            axes.xaxis.set_major_formatter(thousands)
            axes.margins(x=0)
            _set_up_panel(axes, title)
            if not is_shared:
                axes.legend(fontsize=7, ncols=2, handlelength=2.2, columnspacing=1.0)
        _hide_unused(grid[len(panels) :])
        drawing.supxlabel("gradient updates", fontsize=10)
        drawing.supylabel(ylabel, fontsize=10)
        if is_shared:
            _legend_above(drawing, _legend_handles(grid))


def _draw_band(axes: Any, curve: Curve, factor: float, label: str, look: Mapping[str, str]) -> None:
    values = factor * curve.values
    every = max(1, len(curve.progress) // MARKED_POINTS)
    axes.plot(curve.progress, values.mean(0), lw=1.6, ms=5, markevery=every, label=label, **look)
    low, high = values.min(0), values.max(0)
    axes.fill_between(curve.progress, low, high, color=look["color"], alpha=0.13, lw=0)


def _rounded_thousands(steps: float, position: int = 0) -> str:
    """Formats 200037 as 200k: a size has whole episodes, so a few more steps than asked for."""
    return thousands(round(steps, 1 - len(str(int(steps)))) if steps >= 10_000 else steps, position)


def _hide_unused(panels: Sequence[Any]) -> None:
    for axes in panels:
        axes.set_visible(False)


def _set_up_panel(axes: Any, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=9, fontweight="bold")
    draw_grid(axes, width=0.6)


def _legend_above(drawing: Any, handles: Sequence[Any]) -> None:
    """Puts a legend above all panels, in as many columns as fit into the figure's width.

    Rows after the first make the figure taller, so that panels keep their height.
    """
    width = 7 * max(len(handle.get_label()) for handle in handles) + 50  # points, at 10 points
    columns = int(72 * drawing.get_figwidth() // width)
    columns = max(1, min(columns, len(handles)))
    n_rows = math.ceil(len(handles) / columns)
    drawing.set_figheight(drawing.get_figheight() + 0.22 * (n_rows - 1))
    drawing.legend(handles=handles, loc="outside upper center", ncols=columns)


def _legend_handles(grid: Sequence[Any]) -> list[Any]:
    """One legend entry for each label of any panel."""
    found: dict[str, Any] = {}
    for axes in grid:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(name, handle)
    return list(found.values())
