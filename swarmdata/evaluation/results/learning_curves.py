"""Learning curves: reading and drawing them, and the interval of their mean."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import line_looks, line_style
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.line_plot import Line, LinePanel, plot_lines
from swarmdata.rollouts.score_intervals import SHARE, UNBOUNDED, Bounds, seed_interval
from swarmdata.types import Double

LAST_PART = 0.2  # share of training whose gain tells whether a curve has leveled off
CURVE_HEIGHT = 1.8  # inches, of a panel of curves

METRIC_ROWS = (("success", "team success (%)", 100.0), ("return", "team return", 1.0))
"""Rows of the figure of online learning: column, label with unit, factor to that unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A metric of K runs of an algorithm over training."""

    progress: Double  # [P] updates or joint steps, increasing
    values: Double  # [K, P]


def read_curve(paths: Sequence[Path], metric: str, *, progress: str = "updates") -> Curve:
    """Reads one metric from `curve.csv` files.

    The `seed` column separates the runs of a file; a file without it holds one run.
    """
    runs: dict[tuple[Path, str], list[tuple[float, float]]] = {}
    for path in paths:
        with Path(path).open(newline="", encoding="utf-8") as file:
            for line, row in enumerate(csv.DictReader(file), start=2):
                point = _number(row, progress, path, line), _number(row, metric, path, line)
                runs.setdefault((path, row.get("seed", "")), []).append(point)
    if not runs:
        raise SchemaError(f"no rows in {[str(path) for path in paths]}, expected at least one run.")
    curves = [np.array(points, np.float64) for points in runs.values()]
    for (path, seed), curve in zip(runs, curves, strict=True):
        if not np.array_equal(curve[:, 0], curves[0][:, 0]) or (np.diff(curve[:, 0]) <= 0).any():
            raise SchemaError(
                f"{path} (seed {seed or 'not given'}) was measured at {len(curve)} values of "
                f"{progress!r}, which do not increase or differ from the {len(curves[0])} of the "
                "first run. Plot only finished runs with the same schedule together."
            )
    return Curve(curves[0][:, 0], np.stack([curve[:, 1] for curve in curves]))


def _number(row: Mapping[str, str | None], column: str, path: Path, line: int) -> float:
    text = row.get(column)
    try:
        return float(text or "missing")
    except ValueError as error:
        raise SchemaError(
            f"{path}, line {line}: column {column!r} is {text!r}, expected a number. "
            f"Columns: {', '.join(map(str, row))}."
        ) from error


def last_gain(curve: Curve) -> float:
    """Mean over runs at the end, minus the mean before the last fifth of the training."""
    before = int((curve.progress <= (1 - LAST_PART) * curve.progress[-1]).sum()) - 1
    means = curve.values.mean(0)
    return float(means[-1] - means[max(before, 0)])


def interval_of(curve: Curve, bounds: Bounds = UNBOUNDED) -> tuple[Double, Double]:
    """Returns the 95 % interval of the mean over runs at each point, [P] each.

    It is for new training seeds on the same episodes: curves keep only means over episodes. A
    single run has none (NaN). It ends at the bounds of the metric.
    """
    found = [seed_interval(point, bounds=bounds) for point in curve.values.T]
    return np.array([each.low for each in found]), np.array([each.high for each in found])


def curve_line(label: str, curve: Curve, look: Mapping[str, Any], factor: float = 1.0) -> Line:
    """The mean over runs in a band from the lowest to the highest, `factor` times as large."""
    values = factor * curve.values
    ends = np.stack([values.mean(0), values.min(0), values.max(0)])
    return Line(label, curve.progress, ends, look)


def plot_curves(
    curves: Mapping[str, Curve],
    path: Path,
    *,
    ylabel: str,
    xlabel: str = "gradient updates",
    references: Mapping[str, float] = {},
    factor: float = 1.0,
    looks: Mapping[str, Mapping[str, str]] = {},
) -> None:
    """Draws one mean line per label in a band from the lowest to the highest run.

    References are heights of dashed lines by label, such as the mean of the dataset; `factor` is
    from values and references to the unit of the axis, 100 for percentages. Labels without looks
    have colors in their order.
    """
    styles = {label: line_style(k) for k, label in enumerate(curves)}
    if set(curves) <= set(looks):
        styles = line_looks({label: looks[label] for label in curves})
    names = {
        label: f"{label} ({len(curve.values)} seeds)" if len(curve.values) > 1 else label
        for label, curve in curves.items()
    }
    lines = [curve_line(names[k], curve, styles[k], factor) for k, curve in curves.items()]
    levels = {label: factor * height for label, height in references.items()}
    panel = LinePanel("", lines, xlabel, ylabel, levels, counts=True)
    plot_lines([[panel]], path, height=CURVE_HEIGHT)


def plot_learning(files: Mapping[str, Mapping[str, Sequence[Path]]], out: Path) -> None:
    """Draws success above and return below, with a column per task and a line per algorithm.

    A line is the mean over runs, its band the 95 % interval for new training seeds on the same
    episodes. The files, by task and algorithm, have the columns `frames`, `success`, `return` and,
    if a file has several runs, `seed`.

    Raises:
        SchemaError: a file is malformed, or runs of a line were measured at different points.
    """
    algorithms = dict.fromkeys(name for lines in files.values() for name in lines)
    styles = {name: line_style(k) for k, name in enumerate(algorithms)}
    rows: list[list[LinePanel]] = []
    for row, (column, ylabel, factor) in enumerate(METRIC_ROWS):
        bounds, limits = (SHARE, (-2.0, 102.0)) if factor != 1.0 else (UNBOUNDED, None)
        rows.append([])
        for k, (task, files_of) in enumerate(files.items()):
            lines = []
            for name, paths in files_of.items():
                curve = read_curve(paths, column, progress="frames")
                means = factor * np.stack([curve.values.mean(0), *interval_of(curve, bounds)])
                n_runs = len(curve.values)
                label = f"{name} ({n_runs} {'run' if n_runs == 1 else 'runs'})"
                lines.append(Line(label, curve.progress, means, styles[name]))
            panel = LinePanel(
                title="" if row else task,
                lines=lines,
                xlabel="joint steps of training" if row else "",
                ylabel="" if k else ylabel,
                limits=limits,
                counts=True,
            )
            rows[-1].append(panel)
    plot_lines(rows, out, height=CURVE_HEIGHT, shares_x=True)
