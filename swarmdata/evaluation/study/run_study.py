"""A study from its file to its pages: the cells, then the sweeps of the best, then the writing."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from swarmdata.errors import StudyError
from swarmdata.evaluation.study.cells.cell_worker import DONE, is_done
from swarmdata.evaluation.study.cells.cells import Cell, cells_of
from swarmdata.evaluation.study.cells.reproduction import Comparison, check_cell
from swarmdata.evaluation.study.cells.run_cells import chosen, folder_of, run_cells
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.evaluation.study.pages.collect_results import findings_of
from swarmdata.evaluation.study.pages.study_folder import write_pages
from swarmdata.evaluation.study.plan import Study


@dataclass(frozen=True)
class Options:
    """How a study is run; nothing here changes its results.

    Attributes:
        out: folder of tables, figures and text.
        work: folder of cells; None: `runs/study-<name>`.
        workers: processes.
        only: pattern of the cells to do, such as `bc/*`; sweeps are left out then.
        again: whether stale cells are removed and done again.
        progress: whether to show bars.
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


def conduct(study: Study, options: Options, command: str) -> tuple[dict[str, str], list[Path]]:
    """Runs what is missing of a study, and writes what is there.

    Args:
        study: the file.
        options: how.
        command: that does the study again, for the page.

    Returns:
        Why cells failed, by name, and the files that were written, the page first.

    Raises:
        StaleCellError: the folder has results of another configuration.
        StudyError: nothing is done, so there is nothing to write.
        UnknownNameError: no such algorithm, setting, dataset or cell.
    """
    cells = all_cells(study, progress=options.progress)
    work = options.work_of(study)
    failures = _run(chosen(cells, options.only), work, options)
    found = findings_of(study, cells, work, failures)
    sections: dict[str, str] = {}
    if study.sweeps and options.only is None:
        # only where it is asked for: it draws, and compiles kernels of channels and sensors
        from swarmdata.evaluation.study.pages.robustness_pages import chosen_of, run_sweeps  # noqa: PLC0415

        swept = chosen_of(found, digest_of)
        extra = {cell.name: cell for each in swept for cell in each.cells}
        failures |= _run(list(extra.values()), work, options)
        done = [each for each in swept if all(is_done(c, folder_of(work, c)) for c in each.cells)]
        sections = run_sweeps(done, work, options.out, progress=options.progress)
        every = {**{cell.name: cell for cell in cells}, **extra}  # some were trained already
        found = findings_of(study, list(every.values()), work, failures)
    return failures, write_pages(found, options.out, command, sections)


def _run(cells: Sequence[Cell], work: Path, options: Options) -> dict[str, str]:
    return run_cells(
        cells, work, workers=options.workers, again=options.again, progress=options.progress
    )


def all_cells(study: Study, *, progress: bool = True) -> list[Cell]:
    """The cells of a study; datasets whose digest nobody published are built for it."""

    @cache
    def digest(dataset: str) -> str:
        return digest_of(dataset, progress=progress)

    return cells_of(study, digest)


def check(study: Study, name: str, options: Options) -> Comparison:
    """Does a finished cell of a study again, elsewhere, and compares.

    Raises:
        UnknownNameError: no such cell.
        StudyError: it is not finished, or several match.
    """
    work = options.work_of(study)
    if (work / "cells" / name / DONE).exists():  # also one that was trained for a sweep
        return check_cell(work / "cells" / name, progress=options.progress)
    found = chosen(all_cells(study, progress=options.progress), name)
    if len(found) > 1:
        raise StudyError(f"{name!r} matches {len(found)} cells, expected one: {found[0].name}, ...")
    return check_cell(folder_of(work, found[0]), progress=options.progress)
