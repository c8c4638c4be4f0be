"""Runs a study: trains and evaluates its cells, sweeps the best ones, and writes the pages."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from swarmdata.errors import StudyError
from swarmdata.evaluation.study.cells.cell_folder import DONE_FILE, cell_folder, is_done
from swarmdata.evaluation.study.cells.cells import Cell, cells_of
from swarmdata.evaluation.study.cells.reproduction import Comparison, reproduce_cell
from swarmdata.evaluation.study.cells.run_cells import run_cells, select_cells
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.evaluation.study.pages.collect_results import Findings, collect_findings
from swarmdata.evaluation.study.pages.study_folder import write_pages
from swarmdata.evaluation.study.plan import Study
from swarmdata.registry.presets import find_spec


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run; no option changes its results.

    Attributes:
        out: folder of tables, figures and text.
        work: folder of cells; None: `runs/study-<name>`.
        workers: processes.
        only: pattern of the cells to run, such as `bc/*`; sweeps are skipped then.
        again: whether stale cells are deleted and run again.
        progress: whether to show progress bars.
    """

    out: Path
    work: Path | None = None
    workers: int = 2
    only: str | None = None
    again: bool = False
    progress: bool = True

    def work_of(self, study: Study) -> Path:
        """Where the study keeps its cells."""
        return self.work or Path("runs") / f"study-{study.name}"


def run_study(
    study: Study, options: StudyOptions, command: str
) -> tuple[dict[str, str], list[Path]]:
    """Runs the cells of a study that are not done yet, and writes the pages of all that are.

    Args:
        study: the plan.
        options: how to run it.
        command: that runs the study again, for the page.

    Returns:
        Why cells failed, by name, and the files that were written, the page first.

    Raises:
        StaleCellError: the folder has results of another configuration.
        StudyError: no cell is done, so there is nothing to write.
        UnknownNameError: no such algorithm, setting, dataset or cell.
    """
    if study.tasks:
        for task in study.tasks.tasks:
            find_spec(task)  # an unknown one is refused before the training
    if study.device != "cpu":
        from swarmdata.learn.training.setup import check_device  # noqa: PLC0415  (torch)

        check_device(study.device)
    cells = all_cells(study, progress=options.progress)
    work = options.work_of(study)
    failures = _run(select_cells(cells, options.only), work, options)
    found = collect_findings(study, cells, work, failures)
    sections: dict[str, str] = {}
    if study.sweeps and options.only is None:
        # imported late: a sweep draws figures and compiles kernels of channels and sensors
        from swarmdata.evaluation.study.shifts.robustness_sections import plan_sweeps, run_sweeps  # noqa: PLC0415  (torch)

        planned = plan_sweeps(found, digest_of)
        extra = {cell.name: cell for sweep in planned for cell in sweep.cells}
        failures |= _run(list(extra.values()), work, options)
        ready = [
            sweep
            for sweep in planned
            if all(is_done(cell, cell_folder(work, cell)) for cell in sweep.cells)
        ]
        sections = run_sweeps(ready, work, options.out, progress=options.progress)
        by_name = {cell.name: cell for cell in cells} | extra  # a swept cell may be in the grid
        found = collect_findings(study, list(by_name.values()), work, failures)
    if options.only is None:
        sections |= _used_elsewhere(found)
    return failures, write_pages(found, options.out, command, sections)


def _used_elsewhere(found: Findings) -> dict[str, str]:
    """Evaluates policies in the other views and tasks of the plan; returns sections by title."""
    sections: dict[str, str] = {}
    if found.study.information:
        from swarmdata.evaluation.study.shifts.transfer_section import run_transfers  # noqa: PLC0415  (torch)

        sections |= run_transfers(found)
    if found.study.tasks:
        from swarmdata.evaluation.study.shifts.task_section import run_tasks  # noqa: PLC0415  (torch)

        sections |= run_tasks(found)
    return sections


def _run(cells: Sequence[Cell], work: Path, options: StudyOptions) -> dict[str, str]:
    return run_cells(
        cells, work, workers=options.workers, again=options.again, progress=options.progress
    )


def all_cells(study: Study, *, progress: bool = True) -> list[Cell]:
    """Returns the cells of a study; a dataset without a published digest is built to get one."""

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
    return reproduce_cell(cell_folder(work, found[0]), progress=options.progress)
