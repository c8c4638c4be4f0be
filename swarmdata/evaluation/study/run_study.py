"""Runs a study: trains and evaluates its cells, sweeps the best ones, and writes the pages."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from swarmdata.errors import StudyError, UnknownNameError
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cells import DONE_FILE, Cell, cells_of
from swarmdata.evaluation.study.cells.run_cells import remove_stale, run_cells, select_cells
from swarmdata.evaluation.study.cells.study_data import digest_of, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, collect_findings
from swarmdata.evaluation.study.pages.study_folder import STUDY, remove_sweeps, write_pages
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.reproduction import Comparison, reproduce_cell
from swarmdata.evaluation.study.shifts.shift_table import TASKS_FILE, TRANSFER_FILE, Shifted
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.output_folder import check_output, filled

if TYPE_CHECKING:
    from swarmdata.evaluation.study.shifts.sweeps import PlannedSweep


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run; no option changes its results."""

    out: Path  # folder of tables and figures
    work: Path | None = None  # folder of cells; None: `runs/study-<name>`
    workers: int = 2  # processes of the engine `local`
    engine: str | Executor = LOCAL
    """Where cells run and policies are evaluated in other conditions, as `build` takes it."""
    only: str | None = None
    """Pattern of the cells to run, such as `bc/*`; sweeps and evaluations in other views and tasks
    are skipped then."""
    shifts_only: bool = False
    """Whether no cell of the grid is run, only sweeps, and finished cells in other views and
    tasks."""
    again: bool = False  # whether stale cells are deleted and run again
    progress: bool = True  # whether to show progress bars

    @property
    def jobs(self) -> JobOptions:
        """Where jobs are done."""
        return {"engine": self.engine, "workers": self.workers, "progress": self.progress}

    def work_of(self, study: Study) -> Path:
        """Where the study keeps its cells."""
        return self.work or Path("runs") / f"study-{study.name}"


class CellList(NamedTuple):
    """The cells of a study as far as they are known."""

    cells: tuple[Cell, ...]  # of the grid, then of sweeps
    open_sweeps: tuple[str, ...]  # whose cells the results of the grid are still to decide


def run_study(
    study: Study, options: StudyOptions, command: str
) -> tuple[dict[str, str], list[Path]]:
    """Runs the cells of a study that are not done yet, and writes the pages of all that are.

    Returns:
        Why cells failed, by name, and the files that were written, the page first.

    Raises:
        OutputError: `options.out` has files that no study wrote.
        StaleCellError: the folder has results of another configuration.
        StudyError: no cell is done, so there is nothing to write.
        UnknownNameError: no such algorithm, setting, dataset or cell.
    """
    check_output(options.out, STUDY)
    if study.tasks:
        for task in study.tasks.tasks:
            find_spec(task)  # an unknown one is refused before the training
    if study.device != "cpu":
        from swarmdata.learn.networks.setup import check_device  # noqa: PLC0415  (torch)

        check_device(study.device)
    cells = all_cells(study, progress=options.progress)
    work = options.work_of(study)
    chosen = [] if options.shifts_only else select_cells(cells, options.only)
    failures = run_cells(chosen, work, again=options.again, **options.jobs)
    measure = options.only is None
    if measure:
        swept = _swept_cells(collect_findings(study, cells, work, failures))
        failures |= run_cells(swept, work, again=options.again, **options.jobs)
    found = _collect(study, cells, work, failures)
    return failures, _write_pages(found, options, command, measure=measure)


def _collect(
    study: Study, cells: Sequence[Cell], work: Path, failures: Mapping[str, str]
) -> Findings:
    """What was measured, by the cells of sweeps too, which the results of others decide on."""
    found = collect_findings(study, cells, work, failures)
    by_name = {cell.name: cell for cell in [*cells, *_swept_cells(found)]}  # some are in the grid
    if len(by_name) == len(cells):
        return found
    return collect_findings(study, list(by_name.values()), work, failures)


def _swept_cells(found: Findings) -> list[Cell]:
    """The cells of the sweeps whose dataset has results."""
    return [cell for sweep in _planned_sweeps(found) for cell in sweep.cells]


def _planned_sweeps(found: Findings) -> "list[PlannedSweep]":
    """The sweeps whose dataset has results."""
    if not found.study.sweeps:
        return []
    from swarmdata.evaluation.study.shifts.sweeps import plan_sweeps  # noqa: PLC0415  (torch)

    return plan_sweeps(found, digest_of)


def _write_pages(
    found: Findings, options: StudyOptions, command: str, *, measure: bool
) -> list[Path]:
    """Writes the pages with what policies reach in other conditions."""
    if found.study.sweeps:
        from swarmdata.evaluation.study.shifts.sweeps import run_sweeps  # noqa: PLC0415  (torch)

        ready = [
            sweep
            for sweep in _planned_sweeps(found)
            if (sweep.is_ready(found.work) if measure else sweep.is_measured(found.work))
        ]
        remove_sweeps(options.out, found.study.sweeps.keys() - {sweep.label for sweep in ready})
        with filled(options.out, STUDY) as folder:
            run_sweeps(ready, found.work, folder, **options.jobs)
    shifts = _used_elsewhere(found, options, measure=measure)
    return write_pages(found, options.out, command, shifts)


def _used_elsewhere(
    found: Findings, options: StudyOptions, *, measure: bool
) -> dict[str, list[Shifted]]:
    """What policies reach in the other views and tasks of the plan, by the name of the file."""
    # imported late: they need torch
    from swarmdata.evaluation.study.shifts.shift import (  # noqa: PLC0415  (torch)
        estimate_shifts,
        plan_other_tasks,
        plan_transfers,
        run_shifts,
    )

    shifts = {TRANSFER_FILE: plan_transfers(found), TASKS_FILE: plan_other_tasks(found)}
    if measure:
        run_shifts([shift for each in shifts.values() for shift in each], **options.jobs)
    rows = {name: estimate_shifts(found, each) for name, each in shifts.items()}
    # where nothing was evaluated yet, it says nothing that some policies do not fit
    return {name: each if any(row.estimates for row in each) else [] for name, each in rows.items()}


def run_one_cell(study: Study, name: str, options: StudyOptions) -> bool:
    """Runs one cell in this process, for schedulers; where it is done, nothing happens.

    Two processes may run the same cell: one waits for the other. Returns whether it was not done.

    Raises:
        UnknownNameError: no such cell.
        StaleCellError: its folder has results of another configuration.
        SwarmdataError: training or evaluation failed.
    """
    # imported late: it needs torch
    from swarmdata.evaluation.study.cells.cell_worker import run_cell  # noqa: PLC0415  (torch)

    cells = {cell.name: cell for cell in list_cells(study, options).cells}
    if name not in cells:
        raise UnknownNameError("cell", name, cells)
    folder = cells[name].folder(options.work_of(study))
    remove_stale([cells[name]], options.work_of(study), again=options.again)
    is_new = not cells[name].is_done(folder)
    run_cell(cells[name], folder)
    return is_new


def collect_study(study: Study, options: StudyOptions, command: str) -> list[Path]:
    """Writes the pages of what is done, and runs nothing.

    Raises:
        OutputError: `options.out` has files that no study wrote.
        StudyError: no cell is done, so there is nothing to write.
    """
    check_output(options.out, STUDY)
    cells = all_cells(study, progress=options.progress)
    found = _collect(study, cells, options.work_of(study), {})
    return _write_pages(found, options, command, measure=False)


def list_cells(study: Study, options: StudyOptions) -> CellList:
    """Returns the cells of a study, with those of the sweeps whose dataset is done."""
    cells, work = all_cells(study, progress=options.progress), options.work_of(study)
    pending = {cell.data for cell in cells if not cell.is_done(cell.folder(work))}
    waiting = tuple(
        label for label, sweep in study.sweeps.items() if short_name(sweep.dataset) in pending
    )
    by_name = {cell.name: cell for cell in cells}
    if len(waiting) < len(study.sweeps):
        for planned in _planned_sweeps(collect_findings(study, cells, work, {})):
            if planned.label not in waiting:
                by_name |= {cell.name: cell for cell in planned.cells}  # some are in the grid
    return CellList(tuple(by_name.values()), waiting)


def all_cells(study: Study, *, progress: bool = True) -> list[Cell]:
    """Returns the cells of a study's grid; data without a published digest are built to get one."""

    @cache
    def digest(dataset: str) -> str:
        return digest_of(dataset, progress=progress)

    return cells_of(study, digest)


def reproduce_study_cell(study: Study, name: str, options: StudyOptions) -> Comparison:
    """Runs a finished cell of a study again in a temporary folder, and compares the results.

    Raises:
        UnknownNameError: no such cell.
        StudyError: it is not finished, or several cells match.
    """
    work = options.work_of(study)
    if (work / "cells" / name / DONE_FILE).exists():  # of the grid or of a sweep
        return reproduce_cell(work / "cells" / name, progress=options.progress)
    found = select_cells(all_cells(study, progress=options.progress), name)
    if len(found) > 1:
        raise StudyError(f"{name!r} matches {len(found)} cells, expected one: {found[0].name}, ...")
    return reproduce_cell(found[0].folder(work), progress=options.progress)
