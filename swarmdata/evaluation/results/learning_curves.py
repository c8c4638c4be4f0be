"""Learning curves: reading them, and the interval of their mean."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_intervals import UNBOUNDED, Bounds, seed_interval
from swarmdata.types import Double

LAST_PART = 0.2
"""Share of training whose gain tells whether a curve has leveled off."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A metric of K runs of an algorithm over training."""

    progress: Double  # [P] updates or joint steps, increasing
    values: Double  # [K, P]


def read_curve(paths: Sequence[Path], metric: str, *, progress: str = "updates") -> Curve:
    """Reads one metric from `curve.csv` files.

    The `seed` column separates the runs of a file; a file without it holds one run.

    Args:
        paths: the files, whose runs are stacked.
        metric: column to read.
        progress: column of the horizontal axis.

    Raises:
        SchemaError: a column is missing, a value is not a number, or runs were measured at
            different points.
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
