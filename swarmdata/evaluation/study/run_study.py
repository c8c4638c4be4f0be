"""Runs a study: its cells, the best ones in other conditions, its pages, and a cell again."""

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata.errors import StudyError, UnknownNameError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cell_worker import run_cell
from swarmdata.evaluation.study.cells.cells import DONE_FILE, RESULTS_FOLDER, Cell, cells_of
from swarmdata.evaluation.study.cells.run_cells import remove_stale, run_cells, select_cells
from swarmdata.evaluation.study.cells.study_data import digest_of, short_name
from swarmdata.evaluation.study.pages.cell_archive import ARCHIVE_FILE, DECIMALS, unpack_cell
from swarmdata.evaluation.study.pages.collect_results import (
    Findings,
    collect_findings,
    is_in_grid,
)
from swarmdata.evaluation.study.pages.study_folder import STUDY, write_pages
from swarmdata.evaluation.study.pages.study_tables import RUN_METRICS
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.shifts.shift import (
    TASKS_FILE,
    TRANSFER_FILE,
    estimate_shifts,
    plan_other_tasks,
    plan_transfers,
    run_shifts,
)
from swarmdata.evaluation.study.shifts.sweeps import plan_sweeps, run_sweeps, sweep_table
from swarmdata.learn.training.run_files import LOSSES, read_table
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.runtime.output_folder import check_output, filled, listed_files, remove_others
from swarmdata.types import Double, check_device


@dataclass(frozen=True)
class StudyOptions:
    """How a study is run; no option changes its results."""

    out: Path  # folder of tables and figures
    work: Path | None = None  # folder of cells; None: `runs/study-<name>`
    workers: int = 2  # processes of the engine `local`
    engine: str | Executor = LOCAL  # where jobs run, as `build` takes it
    only: str | None = None  # pattern of cells to run, such as `bc/*`, without other conditions
    shifts_only: bool = False  # whether finished cells are run in other conditions, and no others
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

    Returns why cells failed, by name, and the files that were written, the page first: none if the
    cells are done, but none is on the study's datasets yet, as after an online row alone.
    """
    check_output(options.out, STUDY)
    for task in study.tasks.tasks if study.tasks else ():
        find_spec(task)  # an unknown one is refused before the training
    check_device(study.device)
    cells, work = all_cells(study, progress=options.progress), options.work_of(study)
    chosen = [] if options.shifts_only else select_cells(cells, options.only)
    failures = run_cells(chosen, work, again=options.again, **options.jobs)
    on_data = [cell for cell in cells if cell.kind == "offline" and is_in_grid(study, cell)]
    if chosen and not failures and not any(cell.is_done(cell.folder(work)) for cell in on_data):
        return failures, []
    measure = options.only is None
    if measure and not options.shifts_only:
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
    return [cell for sweep in plan_sweeps(found) for cell in sweep.cells]


def _write_pages(
    found: Findings, options: StudyOptions, command: str, *, measure: bool
) -> list[Path]:
    work, jobs = found.work, options.jobs
    if found.study.sweeps:
        ready = [
            sweep
            for sweep in plan_sweeps(found)
            if (sweep.is_ready(work) if measure else sweep.is_measured(work))
        ]
        others = found.study.sweeps.keys() - {sweep.label for sweep in ready}
        kept = listed_files(options.out, STUDY).difference(map(sweep_table, others))
        remove_others(options.out, STUDY, kept)
        with filled(options.out, STUDY) as folder:
            run_sweeps(ready, work, folder, **jobs)
    shifts = {TRANSFER_FILE: plan_transfers(found), TASKS_FILE: plan_other_tasks(found)}
    if measure:
        run_shifts([shift for each in shifts.values() for shift in each], **jobs)
    rows = {name: estimate_shifts(found, each) for name, each in shifts.items()}
    return write_pages(found, options.out, command, rows)


def run_one_cell(study: Study, name: str, options: StudyOptions) -> bool:
    """Runs one cell in this process, for schedulers; where it is done, nothing happens.

    Two processes may run the same cell: one waits for the other. Returns whether it was not done.

    Raises:
        StaleCellError: its folder has results of another configuration.
        SwarmdataError: training or evaluation failed.
    """
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
        for planned in plan_sweeps(collect_findings(study, cells, work, {})):
            if planned.label not in waiting:
                by_name |= {cell.name: cell for cell in planned.cells}  # some are in the grid
    return CellList(tuple(by_name.values()), waiting)


def all_cells(study: Study, *, progress: bool) -> list[Cell]:
    """Returns the cells of a study's grid; data without a published digest are built to get one."""
    return cells_of(study, cache(partial(digest_of, progress=progress)))


class Comparison(NamedTuple):
    """Two runs of the same cell."""

    cell: str  # its name
    n_values: int  # of results, as pages show them: seeds times episodes times metrics
    n_different: int
    largest_difference: float  # of two values that both runs define
    n_one_sided: int  # values that one run defines and the other does not, among the different
    has_losses: bool  # whether they are compared; a cell unpacked from an archive has none
    first_differing_update: int | None  # of the losses; None: none differs
    mean_returns: tuple[float, float]  # over seeds and episodes, of the first run and of this one

    @property
    def is_same(self) -> bool:
        """Whether the results, as pages show them, and the losses are the same."""
        return self.n_different == 0 and self.first_differing_update is None

    def sentence(self) -> str:
        """The comparison in words."""
        if self.is_same:
            losses = " and all losses" if self.has_losses else ""
            return f"{self.cell}: all {self.n_values:,} values{losses} are the same."
        first, alone = self.first_differing_update, self.n_one_sided
        one_sided = f" (only one run defines {alone:,} of them)" if alone else ""
        losses = "losses are equal" if self.has_losses else "losses were not kept"
        if first is not None:
            losses = f"losses differ from update {first:,} on"
        before, now = self.mean_returns
        return (
            f"{self.cell}: {self.n_different:,} of {self.n_values:,} values differ, by at most "
            f"{self.largest_difference:g}{one_sided}; {losses}. The mean return was {before:.5g} "
            f"and is {now:.5g}. Equal numbers are promised only on the same machine with the same "
            "versions."
        )


def reproduce_cell(folder: Path, source: str | None = None, *, progress: bool) -> Comparison:
    """Runs a finished cell again in a temporary folder, from its recorded configuration.

    `source` is where its data are, if that is not recorded.
    """
    if not (folder / DONE_FILE).exists():
        raise StudyError(f"{folder.parent.name}/{folder.name} is not finished. Run it first.")
    cell = Cell.in_folder(folder)
    if source is not None:
        cell = cell.model_copy(update={"source": source})
    with tempfile.TemporaryDirectory(prefix="swarmdata-check-") as temporary:
        failures = run_cells([cell], Path(temporary), workers=1, progress=progress)
        if failures:
            raise StudyError(f"{cell.name} failed when it was run again: {failures[cell.name]}")
        again = cell.folder(Path(temporary))
        results = (_metrics(folder / RESULTS_FOLDER), _metrics(again / RESULTS_FOLDER))
        differences = _result_differences(*results)
        losses = (cell.run_in(folder) / LOSSES, cell.run_in(again) / LOSSES)
        has_losses = losses[0].exists()
        first = _first_difference(*losses) if has_losses else None
    return Comparison(
        cell=cell.name,
        n_values=len(differences),
        n_different=int((differences > 0).sum()),
        largest_difference=float(differences[np.isfinite(differences)].max(initial=0.0)),
        n_one_sided=int(np.isinf(differences).sum()),
        has_losses=has_losses,
        first_differing_update=first,
        mean_returns=(_mean_return(results[0]), _mean_return(results[1])),
    )


def _metrics(folder: Path) -> list[dict[str, Double]]:
    """The metrics of each seed's episodes that pages are made from, and archives keep."""
    seeds = [load_result(file).evaluation.metrics for file in sorted(folder.glob("*.json"))]
    return [
        {name: metrics[name].round(DECIMALS) for name in metrics if name in RUN_METRICS}
        for metrics in seeds
    ]


def _mean_return(seeds: Sequence[Mapping[str, Double]]) -> float:
    return float(np.mean([metrics["return"] for metrics in seeds]))


def _result_differences(
    one: Sequence[Mapping[str, Double]], other: Sequence[Mapping[str, Double]]
) -> Double:
    """Absolute differences of all values; infinity for a value that only one side defines."""
    found = []
    for first, second in zip(one, other, strict=True):
        for name, a in first.items():
            b = second[name]
            both_undefined = np.isnan(a) & np.isnan(b)
            found.append(np.where(both_undefined, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf)))
    return np.concatenate(found)


def _first_difference(one: Path, other: Path) -> int | None:
    pairs = zip(read_table(one), read_table(other), strict=True)
    return next((int(a["update"]) for a, b in pairs if a != b), None)


def reproduce_study_cell(study: Study, name: str, options: StudyOptions) -> Comparison:
    """Runs a finished cell of a study again in a temporary folder, and compares the results.

    A cell that is not in the folder for runs is taken from the archive beside the study's page.

    Raises:
        UnknownNameError: no such cell.
        StudyError: it is not finished, or `name` matches several.
    """
    folder = options.work_of(study) / "cells" / name
    if (folder / DONE_FILE).exists():  # also one of a sweep
        return reproduce_cell(folder, progress=options.progress)
    found = select_cells(all_cells(study, progress=options.progress), name)
    if len(found) > 1:
        raise StudyError(f"{name!r} matches {len(found)} cells, expected one: {found[0].name}, ...")
    with tempfile.TemporaryDirectory(prefix="swarmdata-check-") as temporary:
        archive, work = options.out / ARCHIVE_FILE, Path(temporary)
        if archive.exists():
            unpack_cell(archive, found[0].name, work)
        folder, source = found[0].folder(work), found[0].source  # archives name no folders
        return reproduce_cell(folder, source, progress=options.progress)
