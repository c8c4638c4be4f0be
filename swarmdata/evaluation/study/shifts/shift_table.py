"""What policies of a study reach in other conditions than those of their training, as CSV."""

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate
from swarmdata.evaluation.results.result_tables import Quantity
from swarmdata.evaluation.study.pages.csv_tables import to_csv
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.store import write_file

TRANSFER_FILE = "transfer.csv"
TASKS_FILE = "tasks.csv"

NO_FIT = "other inputs"
"""Stands where a policy cannot read what it would be given, or the robots are others."""

METRIC, ESTIMATE = "metric", ("estimate", "low", "high")


class Shifted(NamedTuple):
    """The policies of a finished cell in one condition."""

    dataset: str  # short name
    label: str  # row of the study
    trained_with: str  # label of the view; empty: as recorded
    used_with: str  # label of the view, or task
    n_runs: int
    n_episodes: int
    estimates: dict[str, Estimate]  # by the quantity's key; empty: the policies do not fit

    def text(self, quantity: Quantity) -> str:
        """The estimate of a quantity for a table."""
        if not self.estimates:
            return NO_FIT
        found = self.estimates.get(quantity.column.key)
        return UNDEFINED if found is None else format_estimate(found, quantity.column)


def write_shifts(found: Sequence[Shifted], file: Path) -> None:
    """Writes a row for each quantity, in stored units; without rows there is no file."""
    if found:
        write_file(file, to_csv([row for each in found for row in _rows(each)]).encode())
    else:
        file.unlink(missing_ok=True)


def _rows(each: Shifted) -> Iterable[dict[str, object]]:
    where = {
        "dataset": each.dataset,
        "policy": each.label,
        "trained_with": each.trained_with,
        "used_with": each.used_with,
        "runs": each.n_runs,
        "episodes": each.n_episodes,
    }
    undefined = Estimate(math.nan, math.nan, math.nan)
    for key, found in (each.estimates or {"": undefined}).items():
        yield {**where, METRIC: key, **dict(zip(ESTIMATE, map(float, found), strict=True))}


def read_shifts(file: Path) -> list[Shifted]:
    """Reads what `write_shifts` wrote; nothing if there is no file."""
    if not file.exists():
        return []
    found: dict[tuple[str, ...], Shifted] = {}
    with file.open(encoding="utf-8", newline="") as text:
        for row in csv.DictReader(text):
            key = (row["dataset"], row["policy"], row["trained_with"], row["used_with"])
            each = found.setdefault(key, Shifted(*key, int(row["runs"]), int(row["episodes"]), {}))
            if row[METRIC]:
                each.estimates[row[METRIC]] = Estimate(
                    *(float(row[name] or math.nan) for name in ESTIMATE)
                )
    return list(found.values())
