"""The estimates of a study's sweeps, from the files beside its page as tables."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import Column, format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES, RETURN, SCORE
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.plan import Study
from swarmdata.rollouts.score_statistics import Estimate

SWEEPS_FOLDER = "sweeps"
"""Holds results in the study's folder of cells, and tables and figures beside its page."""

SWEEP_FILE = "sweep.csv"

SUCCESS, CLEAN = QUANTITIES["success"], QUANTITIES["clean_success"]


class SweptAxis(NamedTuple):
    """One sweep of a study."""

    label: str  # in the plan
    rows: list[dict[str, str]]  # of its table, in the order of the axis

    @property
    def name(self) -> str:
        """The parameter with its part, such as `communication drop`."""
        return f"{self.rows[0]['part']} {self.rows[0]['parameter']}"

    @property
    def n_episodes(self) -> int:
        """Seeds at each value."""
        return int(self.rows[0]["episodes"])


def read_sweeps(study: Study, folder: Path) -> list[SweptAxis]:
    """Reads the sweeps of a study's plan that stand beside its page, by label.

    Args:
        study: the plan.
        folder: of its page.
    """
    found = []
    for label in sorted(study.sweeps):
        file = folder / SWEEPS_FOLDER / label / SWEEP_FILE
        if file.exists():
            with file.open(encoding="utf-8", newline="") as text:
                found.append(SweptAxis(label, list(csv.DictReader(text))))
    return found


def sweep_table(axis: SweptAxis) -> str:
    """A row for each row of the study: as trained, and at the worst value."""
    estimates = {
        (row["policy"], row["value"], row["metric"]): Estimate(
            *(float(row[name] or math.nan) for name in ("estimate", "low", "high"))
        )
        for row in axis.rows
    }
    trained = {row["policy"]: row["value"] for row in axis.rows if row["as_trained"] == "1"}
    worst = axis.rows[-1]["value"]
    metrics = {row["metric"] for row in axis.rows}
    changed = next(each.column for each in (SCORE, RETURN) if _change(each.column) in metrics)
    rows = []
    for label, value in trained.items():
        solved = (
            format_estimate(estimates[label, at, each.column.key], each.column)
            for at in (value, worst)
            for each in (SUCCESS, CLEAN)
        )
        change = estimates[label, worst, _change(changed)]
        rows.append((f"`{label}`", *solved, format_difference(change, changed)))
    headers = (SUCCESS.column.header, CLEAN.column.header)
    head = (
        axis.label,
        *(f"{each}, as trained" for each in headers),
        *(f"{each}, {axis.rows[0]['parameter']} {float(worst):g}" for each in headers),
        f"change of {changed.label}",
    )
    return markdown.table(head, rows)


def _change(column: Column) -> str:
    """The key of the change of a quantity since training."""
    return f"{column.key}_change"
