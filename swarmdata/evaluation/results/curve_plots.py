"""Learning curves and comparisons, drawn with matplotlib and saved as PNG, SVG or PDF."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import COLORS, GRAY, colors, draw_grid, figure, thousands
from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.types import Double


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One metric of K runs of one algorithm over training."""

    progress: Double  # [P] updates or frames, increasing
    values: Double  # [K, P]


def read_curve(paths: Sequence[Path], metric: str, *, progress: str = "updates") -> Curve:
    """Reads one metric from `curve.csv` files.

    Rows are told apart by their `seed` column; a file without one is one run.

    Args:
        paths: the files; their runs are put together.
        metric: column to read.
        progress: column of the horizontal axis.

    Raises:
        SchemaError: a column is missing, a value is no number, or runs were measured at different
            points.
    """
    runs: dict[tuple[Path, str], list[tuple[float, float]]] = {}
    for path in paths:
        with Path(path).open(newline="", encoding="utf-8") as file:
            for line, row in enumerate(csv.DictReader(file), start=2):
                point = _number(row, progress, path, line), _number(row, metric, path, line)
                runs.setdefault((path, row.get("seed", "")), []).append(point)
    if not runs:
        raise SchemaError(f"no rows in {[str(path) for path in paths]}, expected at least one run.")
    tracks = [np.array(points, np.float64) for points in runs.values()]
    for (path, seed), track in zip(runs, tracks, strict=True):
        if not np.array_equal(track[:, 0], tracks[0][:, 0]) or (np.diff(track[:, 0]) <= 0).any():
            raise SchemaError(
                f"{path} (seed {seed or 'not given'}) was measured at {len(track)} values of "
                f"{progress!r} that do not increase or are not those of the first run "
                f"({len(tracks[0])}). Plot finished runs of one schedule together."
            )
    return Curve(tracks[0][:, 0], np.stack([track[:, 1] for track in tracks]))


def _number(row: Mapping[str, str | None], column: str, path: Path, line: int) -> float:
    text = row.get(column)
    try:
        return float(text or "missing")
    except ValueError as error:
        raise SchemaError(
            f"{path}, line {line}: column {column!r} is {text!r}, expected a number. "
            f"Columns: {', '.join(map(str, row))}."
        ) from error


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
        references: label -> height of a dashed line, such as the dataset's own mean.
        factor: from values to the shown unit: 100 for percentages. References are scaled as well.

    Raises:
        SchemaError: nothing to draw, or an unknown suffix.
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
            _draw_reference(axes, label, factor * height)
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.xaxis.set_major_formatter(thousands)
        axes.margins(x=0)
        draw_grid(axes, "y")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(3, len(curves)))


def _draw_reference(axes: Any, label: str, height: float) -> None:
    """A dashed line across, named at its right end."""
    axes.axhline(height, color=GRAY, lw=1, ls=(0, (4, 3)), zorder=1)
    axes.annotate(
        label,
        (1.0, height),
        xycoords=("axes fraction", "data"),
        xytext=(5, 0),
        textcoords="offset points",
        va="center",
        color="#5A616B",
        fontsize=9,
        annotation_clip=False,
    )


def plot_estimates(panels: Mapping[str, Mapping[str, Estimate]], path: Path) -> None:
    """Draws estimates as points with intervals: one panel per quantity, one row per policy.

    Args:
        panels: axis label with unit -> policy -> estimate in that unit, the same policies in every
            panel, first on top; `report.Table.panels` gives it.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: nothing to draw, panels of different policies, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    rows = [list(estimates) for estimates in panels.values()]
    if not rows or not rows[0] or any(labels != rows[0] for labels in rows):
        raise SchemaError(
            f"panels {list(panels)} have the rows {rows}, expected at least one panel and row, and "
            "the same rows in every panel."
        )
    labels = rows[0]
    with figure(path, width=1.6 + 2.5 * len(panels), height=0.9 + 0.34 * len(labels)) as drawing:
        axes = drawing.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for panel, (xlabel, estimates) in zip(axes, panels.items(), strict=True):
            _points(panel, list(estimates.values()))
            panel.set_xlabel(xlabel)
        axes[0].set_yticks(range(len(labels)), labels)
        axes[0].set_ylim(len(labels) - 0.5, -0.5)  # first row on top


def _points(panel: Any, estimates: Sequence[Estimate]) -> None:
    for y, (value, low, high) in enumerate(estimates):
        panel.plot([low, high], [y, y], color=COLORS[0], alpha=0.45, lw=4, solid_capstyle="butt")
        face = "white" if math.isnan(low) else COLORS[0]  # without an interval: not a measurement
        panel.plot([value], [y], "o", color=COLORS[0], mfc=face, ms=5)
    draw_grid(panel, "x")
    panel.margins(x=0.08)
    panel.spines["left"].set_visible(False)
    panel.tick_params(axis="y", length=0)
