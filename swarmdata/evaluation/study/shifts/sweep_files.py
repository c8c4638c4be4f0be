"""The estimates of a study's sweeps, from the files beside its page as tables."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES, RETURN, SCORE
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.plan import Study
from swarmdata.rollouts.score_statistics import Estimate

SWEEPS_FOLDER = "sweeps"
"""Holds results in the study's folder of cells, and tables and figures beside its page."""

SWEEP_FILE = "sweep.csv"

SUCCESS, CLEAN = QUANTITIES["success"], QUANTITIES["clean_success"]


def picture_of(part: str, parameter: str) -> str:
    """The name of a sweep's figure."""
    return f"{part}-{parameter}.png"


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


def read_sweeps(study: Study, folder: Path) -> list[SweptAxis]:
    """Reads the sweeps of a study's plan that stand beside its page, by label.

    Args:
        study: the plan.
        folder: of its page.
    """
    files = (folder / SWEEPS_FOLDER / label / SWEEP_FILE for label in sorted(study.sweeps))
    return [_read(file) for file in files if file.exists()]


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


def sweep_table(axis: SweptAxis) -> str:
    """A row for each row of the study: as trained, and at the worst value."""
    changed = next(
        each.column
        for each in (SCORE, RETURN)
        if f"{each.column.key}_change" in next(iter(axis.lines.values()))[-1].estimates
    )
    rows = []
    for label, points in axis.lines.items():
        ends = (next(point for point in points if point.is_trained), points[-1])
        solved = (
            format_estimate(point.estimates[each.column.key], each.column)
            for point in ends
            for each in (SUCCESS, CLEAN)
        )
        change = points[-1].estimates[f"{changed.key}_change"]
        rows.append((f"`{label}`", *solved, format_difference(change, changed)))
    worst = f"{axis.parameter} {next(iter(axis.lines.values()))[-1].value:g}"
    headers = (SUCCESS.column.header, CLEAN.column.header)
    head = (
        axis.label,
        *(f"{each}, as trained" for each in headers),
        *(f"{each}, {worst}" for each in headers),
        f"change of {changed.label}",
    )
    return markdown.table(head, rows)
