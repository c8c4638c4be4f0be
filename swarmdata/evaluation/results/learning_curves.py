"""Learning curves: reading them, grouping their files, and the interval of their mean."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.learn.training.run_files import CURVE, run_folders
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


def curve_files(path: Path) -> list[Path]:
    """Returns the learning curves at a path: of a run folder, those of all its processes.

    Args:
        path: a CSV file, or the folder of a training run.

    Raises:
        SchemaError: the folder has none.
    """
    if not path.is_dir():
        return [path]
    found = [folder / CURVE for folder in run_folders(path)]
    if not found or not all(file.exists() for file in found):
        raise SchemaError(
            f"{path} is no training run with a learning curve; expected the folder of a run in "
            f"which policies were evaluated, or a copy of its {CURVE}."
        )
    return found


_GROUP_PATTERNS = {"algorithm": "(?P<algorithm>[^/-]+)", "task": "(?P<task>[^/]+)", "*": "[^/]*"}

GroupedFiles = Mapping[str, Mapping[str, Sequence[Path]]]
"""Task -> algorithm -> files of its runs."""


def group_files(files: Sequence[Path], pattern: str) -> dict[str, dict[str, list[Path]]]:
    """Groups files of runs by the task and the algorithm in their names.

    Args:
        files: such as `runs/mappo/coop_nav/curve.csv`, and run folders such as
            `runs/mappo/coop_nav`.
        pattern: how paths end, without the suffix, with `algorithm` and `task` once each and `*`
            for anything; in this example `algorithm/task/*`. Names of tasks may have hyphens,
            names of algorithms may not.

    Returns:
        task -> algorithm -> files, in the order of their first file.

    Raises:
        SchemaError: the pattern lacks a word, or a file does not match it.
    """
    parts = re.split(r"(algorithm|task|\*)", pattern)
    if sorted(part for part in parts if part in ("algorithm", "task")) != ["algorithm", "task"]:
        raise SchemaError(
            f"pattern {pattern!r} does not have 'algorithm' and 'task' once each. For "
            "mappo/coop_nav.csv it is 'algorithm/task'."
        )
    expression = "".join(_GROUP_PATTERNS.get(part, re.escape(part)) for part in parts)
    found: dict[str, dict[str, list[Path]]] = {}
    for file in files:
        name = file if file.is_dir() else file.with_suffix("")
        match = re.search(f"(?:^|/){expression}$", name.as_posix())
        if match is None:
            raise SchemaError(
                f"{file} does not match the pattern {pattern!r}, so its algorithm and task are "
                "unknown. Rename the files, or pass another --by."
            )
        task, algorithm = match["task"], match["algorithm"]
        found.setdefault(task, {}).setdefault(algorithm, []).extend(curve_files(file))
    return found


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
