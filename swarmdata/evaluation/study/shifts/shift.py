"""The policies of a finished cell in other conditions: what to evaluate, and what they reach."""

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from swarmdata.errors import PolicyFitError
from swarmdata.evaluation.results.evaluation_jobs import (
    Evaluation,
    TargetName,
    evaluations_of,
    run_evaluations,
)
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import QUANTITIES, estimate, quantities_of
from swarmdata.evaluation.study.cells.cell_folder import cell_folder, cell_run_folder
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.specs.model_choice import Source

_LOG = logging.getLogger("swarmdata")


@dataclass(frozen=True)
class Shift:
    """The policies of a finished cell in one condition.

    Attributes:
        place: names of the cell and of the condition, without estimates.
        evaluations: one for each policy; none: the policies cannot read what they would be given,
            or the robots are others; None: the cell was restored from a study's archive, which has
            results and no policies.
    """

    place: Shifted
    evaluations: tuple[Evaluation, ...] | None


def plan_shift(
    found: Findings, cell: Cell, conditions: Mapping[str, Source], results: Path, place: Shifted
) -> Shift:
    """Finds what there is to evaluate.

    Args:
        found: what was measured.
        cell: a finished one.
        conditions: `task`, `observation` and `communication`, as `find_target` takes them.
        results: folder that keeps the episodes, so that an interrupted study resumes.
        place: names of the conditions, and the number of seeds of the study's block.
    """
    run = cell_run_folder(cell, cell_folder(found.work, cell))
    if not run.is_dir():
        return Shift(place, None)
    source = TargetName.of(str(run), **conditions)  # type: ignore[arg-type]  # tasks are names
    try:
        target = source.find()
    except PolicyFitError:
        return Shift(place, ())
    evaluations = evaluations_of(source, target, place.n_episodes, results, block=found.study.block)
    return Shift(place, tuple(evaluations))


def run_shifts(
    shifts: Sequence[Shift],
    *,
    engine: str | Executor = LOCAL,
    workers: int = 1,
    progress: bool = True,
) -> None:
    """Evaluates what is not kept yet; a warning names cells without policies.

    Args:
        shifts: may be none.
        engine: where policies are evaluated, as `build` takes it.
        workers: processes of the engine `local`; 1: this one.
        progress: whether to show a progress bar.

    Raises:
        SwarmdataError: as `run_evaluations` says.
    """
    for place in (shift.place for shift in shifts if shift.evaluations is None):
        _LOG.warning(
            "%s/%s has no policies in the folder of cells, so it is not evaluated in %s: make it "
            "again with --cell and --again", place.label, place.dataset, place.used_with,
        )  # fmt: skip
    every = [each for shift in shifts for each in shift.evaluations or ()]
    if every:
        run_evaluations(every, engine=engine, workers=workers, progress=progress)


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
