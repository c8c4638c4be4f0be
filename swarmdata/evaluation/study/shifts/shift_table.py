"""What policies of a study reach in other conditions than those of their training: CSV, tables."""

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate, to_csv
from swarmdata.evaluation.results.result_tables import QUANTITIES, UNDEFINED_ESTIMATE, Quantity
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version
from swarmdata.store import write_file

TRANSFER_FILE = "transfer.csv"
TASKS_FILE = "tasks.csv"

NO_FIT = "other inputs"
"""Stands where a policy cannot read what it would be given, or the robots are others."""

TASKS_FIGURE = "tasks.png"

TRAINED = "task of training"

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
    for key, found in (each.estimates or {"": UNDEFINED_ESTIMATE}).items():
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


def transfer_section(found: Findings, rows: Sequence[Shifted]) -> dict[str, str]:
    """A matrix for each dataset and algorithm, by the section's title; empty without rows."""
    if not rows:
        return {}
    quantity = quantity_of(found.results)
    text = (
        "Rows are the view that a policy learned in, columns that of its evaluation, on "
        f"{rows[0].n_episodes:,} seeds: {quantity.column.label}.\n\n"
    )
    tables = [
        f"`{label}` on {dataset}:\n\n"
        + markdown.pivot(
            "learned with",
            dict.fromkeys(row.used_with for row in group),
            {(row.trained_with, row.used_with): row.text(quantity) for row in group},
        )
        for (dataset, label), group in _grouped(rows).items()
    ]
    return {"Information: learned with one, used with another": text + "\n".join(tables)}


def _grouped(rows: Sequence[Shifted]) -> dict[tuple[str, str], list[Shifted]]:
    groups: dict[tuple[str, str], list[Shifted]] = {}
    for row in rows:
        groups.setdefault((row.dataset, row.label), []).append(row)
    return groups


def task_section(found: Findings, rows: Sequence[Shifted], out: Path) -> dict[str, str]:
    """A table for each dataset and quantity, by the section's title; empty without rows."""
    if not rows:
        return {}
    quantities = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    text = (
        "Policies of the study in tasks that they were not trained in, on "
        f"{rows[0].n_episodes:,} seeds. Sensors and radios are those of their training. A score is "
        "between doing nothing and the expert in each task.\n\n"
    )
    tables = [
        markdown.pivot(
            f"{dataset}: {quantity.column.header}",
            dict.fromkeys(row.used_with for row in rows if row.dataset == dataset),
            {(r.label, r.used_with): r.text(quantity) for r in rows if r.dataset == dataset},
        )
        for dataset in dict.fromkeys(row.dataset for row in rows)
        for quantity in quantities
    ]
    _plot_tasks(found, rows, out / TASKS_FIGURE)
    picture = f"\n![success by task]({TASKS_FIGURE})\n"
    return {"Other places and sizes of teams": text + "\n".join(tables) + picture}


def _plot_tasks(found: Findings, rows: Sequence[Shifted], path: Path) -> None:
    """Draws success, a row for each dataset and algorithm, a column for each task."""
    board = found.board("success")
    trained = {without_version(name): board.in_shown_units(name) for name in board.estimates}
    cells: dict[tuple[str, str], MatrixCell] = {}
    names: dict[str, list[str]] = {}
    for (dataset, label), group in _grouped(rows).items():
        own = trained[without_version(dataset)][label].value
        name = f"{dataset}: {label}"
        names.setdefault(dataset, []).append(name)
        cells[name, TRAINED] = MatrixCell(own, 0.0)
        for each in group:
            if "success" in each.estimates:
                solved = board.column.factor * each.estimates["success"].value
                cells[name, each.used_with] = MatrixCell(solved, solved - own)
    columns = [TRAINED, *dict.fromkeys(each.used_with for each in rows)]
    notes = Notes(
        100.0, "success minus that in the task of training, percentage points",
        "number: success (%); dot: the policy has inputs of another size",
    )  # fmt: skip
    plot_matrix(cells, names, {"": columns}, path, notes)
