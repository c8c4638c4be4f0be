"""The policies of a study in other views and tasks: evaluations, a CSV table, and sections."""

import csv
import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Unpack

from swarmdata.drawing import markdown
from swarmdata.errors import PolicyFitError
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate, to_csv
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import (
    UNDEFINED_ESTIMATE,
    Quantity,
    estimate,
    quantities_of,
)
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, results_of
from swarmdata.evaluation.study.pages.data_views import view_cells
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.model_choice import Source
from swarmdata.store import write_file

TRANSFER_FILE = "transfer.csv"
TASKS_FILE = "tasks.csv"

TASKS_FIGURE = "tasks.png"

NO_FIT = "other inputs"  # where a policy cannot read what it would be given, or has other robots
TRAINED = "task of training"

COLUMNS = ("dataset", "policy", "trained_with", "used_with", "runs", "episodes", "metric",
           "estimate", "low", "high")  # fmt: skip


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
    rows = [
        dict(zip(COLUMNS, (*each[:-1], key, *map(float, estimate)), strict=True))
        for each in found
        for key, estimate in (each.estimates or {"": UNDEFINED_ESTIMATE}).items()
    ]
    if rows:
        write_file(file, to_csv(rows).encode())


def read_shifts(file: Path) -> list[Shifted]:
    """Reads what `write_shifts` wrote; nothing if there is no file."""
    if not file.exists():
        return []
    found: dict[tuple[str, ...], Shifted] = {}
    with file.open(encoding="utf-8", newline="") as text:
        for row in csv.DictReader(text):
            data, label, trained, used, runs, episodes, metric, *ends = (row[k] for k in COLUMNS)
            each = Shifted(data, label, trained, used, int(runs), int(episodes), {})
            each = found.setdefault((data, label, trained, used), each)
            if metric:
                each.estimates[metric] = Estimate(*(float(end or math.nan) for end in ends))
    return list(found.values())


def transfer_section(found: Findings, rows: Sequence[Shifted]) -> dict[str, str]:
    """A matrix for each dataset and algorithm, by the section's title; empty without rows."""
    if not rows:
        return {}
    quantity = found.quantities[0]
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
        for quantity in found.quantities
    ]
    _plot_tasks(found, rows, out / TASKS_FIGURE)
    picture = f"\n![success by task]({TASKS_FIGURE})\n"
    return {"Other places and sizes of teams": text + "\n".join(tables) + picture}


def _plot_tasks(found: Findings, rows: Sequence[Shifted], path: Path) -> None:
    board = found.board("success")
    cells: dict[tuple[str, str], MatrixCell] = {}
    names: dict[str, list[str]] = {}
    for (dataset, label), group in _grouped(rows).items():
        own = board.in_shown_units(found.dataset_ids[dataset])[label].value
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


_LOG = logging.getLogger("swarmdata")

TRANSFER_FOLDER, TASKS_FOLDER = "transfer", "tasks"  # of results, in the folder of cells


@dataclass(frozen=True)
class Shift:
    """The policies of a finished cell in one condition."""

    place: Shifted  # names of the cell and of the condition, without estimates
    evaluations: tuple[Evaluation, ...] | None  # of each policy; (): none fits; None: none is kept


def plan_shift(
    found: Findings, cell: Cell, conditions: Mapping[str, Source], results: Path, place: Shifted
) -> Shift:
    """Finds what there is to evaluate of a finished cell.

    The conditions are `task`, `observation` and `communication`, as `find_target` takes them; the
    folder of results keeps the episodes, so that an interrupted study resumes.
    """
    run = cell.run_in(cell.folder(found.work))
    if not run.is_dir():  # restored from an archive, which has results and no policies
        return Shift(place, None)
    source = TargetName.parse({"name": run, **conditions})
    try:
        target = source.find()
    except PolicyFitError:  # other inputs, or other robots
        return Shift(place, ())
    evaluations = evaluations_of(source, target, place.n_episodes, results, block=found.study.block)
    return Shift(place, tuple(evaluations))


def run_shifts(shifts: Sequence[Shift], **options: Unpack[JobOptions]) -> None:
    """Evaluates what is not kept yet; a warning names cells without policies."""
    for place in (shift.place for shift in shifts if shift.evaluations is None):
        _LOG.warning(
            "%s/%s has no policies in the folder of cells, so it is not evaluated in %s: make it "
            "again with --cell and --again", place.label, place.dataset, place.used_with,
        )  # fmt: skip
    every = [each for shift in shifts for each in shift.evaluations or ()]
    if every:
        run_evaluations(every, **options)


def estimate_shifts(found: Findings, shifts: Sequence[Shift]) -> list[Shifted]:
    """Estimates what policies reach, without those that were not evaluated yet.

    Before anything was evaluated, it says nothing that some policies do not fit.
    """
    rows = [row for shift in shifts if (row := _estimate(found, shift)) is not None]
    return rows if any(row.estimates for row in rows) else []


def _estimate(found: Findings, shift: Shift) -> Shifted | None:
    if not shift.evaluations:
        return None if shift.evaluations is None else shift.place
    results = [kept for each in shift.evaluations if (kept := each.result()) is not None]
    if len(results) < len(shift.evaluations):
        return None
    (case,) = group_results(results).cases
    known = [each for each in found.quantities if each in quantities_of(case)]
    estimates = {each.column.key: estimate(each, case, shift.place.label) for each in known}
    return shift.place._replace(estimates=estimates)


def plan_other_tasks(found: Findings) -> list[Shift]:
    """Returns the finished rows of the plan in each of its other tasks."""
    plan = found.study.tasks
    if plan is None:
        return []
    n_episodes = found.study.shifted_episodes(plan.episodes)
    datasets = [short_name(dataset) for dataset in plan.datasets]
    shifts = []
    for cell, task in itertools.product(found.cells, plan.tasks):
        if cell.kind == "offline" and cell.data in datasets and cell.label in plan.algorithms:
            name = Path(task).stem
            folder = found.work / TASKS_FOLDER / cell.label / cell.data / name
            place = Shifted(cell.data, cell.label, "", name, len(cell.seeds), n_episodes, {})
            shifts.append(plan_shift(found, cell, {"task": task}, folder, place))
    return shifts


def plan_transfers(found: Findings) -> list[Shift]:
    """Returns the finished rows of each view in all views of the plan."""
    plan = found.study.information
    if plan is None:
        return []
    n_episodes = found.study.shifted_episodes(plan.transfer_episodes)
    shifts = []
    for dataset in map(short_name, plan.datasets):
        for label in plan.transfer:
            cells = {view: c for view, c in view_cells(found, dataset) if c.label == label}
            models = {view: _models_of(found, cell) for view, cell in cells.items()}
            for (view, cell), other in itertools.product(cells.items(), models):
                place = Shifted(dataset, label, view, other, len(cell.seeds), n_episodes, {})
                folder = found.work / TRANSFER_FOLDER / label / cell.data / other
                shifts.append(plan_shift(found, cell, models[other], folder, place))
    return shifts


def _models_of(found: Findings, cell: Cell) -> dict[str, Source]:
    spec = results_of([cell], found.work)[0].spec.world
    assert spec is not None  # a cell of a recording of another environment is not evaluated
    return {"observation": spec.observation, "communication": spec.communication}
