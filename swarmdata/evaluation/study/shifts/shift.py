"""The policies of finished cells in other views and tasks: what to evaluate, what they reach."""

import itertools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from swarmdata.errors import PolicyFitError
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import QUANTITIES, estimate, quantities_of
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, results_of
from swarmdata.evaluation.study.pages.data_views import label_of, view_cells
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.specs.model_choice import Source

_LOG = logging.getLogger("swarmdata")

TRANSFER_FOLDER, TASKS_FOLDER = "transfer", "tasks"
"""Hold results in the study's folder of cells: LABEL/DATA/VIEW, and LABEL/DATA/TASK."""


@dataclass(frozen=True)
class Shift:
    """The policies of a finished cell in one condition."""

    place: Shifted  # names of the cell and of the condition, without estimates
    evaluations: tuple[Evaluation, ...] | None
    """One for each policy; none: the policies cannot read what they would be given, or the robots
    are others; None: the cell was restored from a study's archive, which has results and no
    policies."""


def plan_shift(
    found: Findings, cell: Cell, conditions: Mapping[str, Source], results: Path, place: Shifted
) -> Shift:
    """Finds what there is to evaluate of a finished cell.

    The conditions are `task`, `observation` and `communication`, as `find_target` takes them; the
    folder of results keeps the episodes, so that an interrupted study resumes.
    """
    run = cell.run_in(cell.folder(found.work))
    if not run.is_dir():
        return Shift(place, None)
    source = TargetName.parse({"name": run, **conditions})
    try:
        target = source.find()
    except PolicyFitError:
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
    """Estimates what policies reach; those that were not evaluated yet are left out."""
    rows = (_estimate(found, shift) for shift in shifts)
    return [row for row in rows if row is not None]


def _estimate(found: Findings, shift: Shift) -> Shifted | None:
    if shift.evaluations is None:
        return None
    if not shift.evaluations:
        return shift.place
    kept = [each.result() for each in shift.evaluations]
    results = [each for each in kept if each is not None]
    if len(results) < len(kept):
        return None
    (case,) = group_results(results).cases
    known = quantities_of(case)
    wanted = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    estimates = {
        each.column.key: estimate(each, case, shift.place.label) for each in wanted if each in known
    }
    return shift.place._replace(estimates=estimates)


def plan_other_tasks(found: Findings) -> list[Shift]:
    """Returns the finished rows of the plan in each of its other tasks."""
    plan = found.study.tasks
    if plan is None:
        return []
    n_episodes = found.study.shifted_episodes(plan.episodes)
    datasets = [short_name(dataset) for dataset in plan.datasets]
    shifts = []
    for cell in found.cells:
        if cell.kind == "offline" and cell.data in datasets and cell.label in plan.algorithms:
            for task in plan.tasks:
                folder = found.work / TASKS_FOLDER / cell.label / cell.data / Path(task).stem
                place = Shifted(cell.data, cell.label, "", task, len(cell.seeds), n_episodes, {})
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
            known = {
                label_of(plan, cell): cell
                for cell in view_cells(found, dataset)
                if cell.label == label
            }
            cells = {view: known[view] for view in plan.views if view in known}
            models = {view: _models_of(found, cell) for view, cell in cells.items()}
            for (view, cell), other in itertools.product(cells.items(), models):
                place = Shifted(dataset, label, view, other, len(cell.seeds), n_episodes, {})
                folder = found.work / TRANSFER_FOLDER / label / cell.data / other
                shifts.append(plan_shift(found, cell, models[other], folder, place))
    return shifts


def _models_of(found: Findings, cell: Cell) -> dict[str, Source]:
    """The models that a cell's policies were evaluated with."""
    spec = results_of([cell], found.work)[0].spec.world
    assert spec is not None  # a cell of a recording of another environment is not evaluated
    return {"observation": spec.observation, "communication": spec.communication}
