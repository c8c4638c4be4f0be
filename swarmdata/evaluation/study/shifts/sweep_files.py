"""The estimates of a study's sweeps, read from the files beside its page."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from swarmdata.rollouts.score_statistics import Estimate

SWEEPS_FOLDER = "sweeps"
"""Holds results in the study's folder of cells, and tables and figures beside its page."""

SWEEP_FILE = "sweep.csv"


class SweptPoint(NamedTuple):
    """A row of policies at one value of the axis."""

    value: float | None  # None: as trained, if that has no number
    is_trained: bool
    estimates: dict[str, Estimate]  # by the metric's key, in stored units; NaN: undefined


class SweptAxis(NamedTuple):
    """One sweep of a study."""

    label: str  # in the plan
    part: str  # observation or communication
    parameter: str
    n_episodes: int
    lines: dict[str, list[SweptPoint]]  # label of a row -> points in the order of the axis

    @property
    def falls(self) -> bool:
        """Whether the values fall, so that the last one is the lowest."""
        values = [each.value for each in next(iter(self.lines.values())) if each.value is not None]
        return values[0] > values[-1]


def read_sweeps(folder: Path) -> list[SweptAxis]:
    """Reads the sweeps beside a study's page, by label.

    Args:
        folder: of the study.
    """
    return [_read(file) for file in sorted(folder.glob(f"{SWEEPS_FOLDER}/*/{SWEEP_FILE}"))]


def _read(file: Path) -> SweptAxis:
    points: dict[tuple[str, str], SweptPoint] = {}
    with file.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    for row in rows:
        value = float(row["value"]) if row["value"] else None
        empty = SweptPoint(value, row["as_trained"] == "1", {})
        point = points.setdefault((row["policy"], row["value"]), empty)
        numbers = (float(row[name] or math.nan) for name in ("estimate", "low", "high"))
        point.estimates[row["metric"]] = Estimate(*numbers)
    lines: dict[str, list[SweptPoint]] = {}
    for (label, _), point in points.items():
        lines.setdefault(label, []).append(point)
    first = rows[0]
    return SweptAxis(
        file.parent.name, first["part"], first["parameter"], int(first["episodes"]), lines
    )
