"""Runs the cells of a study, each in a fresh process; a failed cell does not stop the others."""

import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from fnmatch import fnmatch
from pathlib import Path

from tqdm import tqdm

from swarmdata.errors import BuildError, StaleCellError, UnknownNameError
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cells import COST_FILE, ERROR_FILE, Cell
from swarmdata.learn.training.run_files import LOSSES
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import LOCAL, open_engine
from swarmdata.runtime.locking import locked

MAX_SHOWN_STALE = 3  # stale cells that an error message names; more are counted

WORKER = "swarmdata.evaluation.study.cells.cell_worker:cell_runner"


def select_cells(cells: Sequence[Cell], pattern: str | None) -> list[Cell]:
    """Returns the cells whose names match a pattern such as `bc/*`; all of them for None."""
    found = [cell for cell in cells if pattern is None or fnmatch(cell.name, pattern)]
    if not found and pattern is not None:
        raise UnknownNameError("cell", pattern, [cell.name for cell in cells])
    return found


def run_cells(
    cells: Sequence[Cell],
    work: Path,
    *,
    workers: int = 2,
    engine: str | Executor = LOCAL,
    again: bool = False,
    progress: bool = True,
) -> dict[str, str]:
    """Runs the cells that are not done yet; returns why cells failed, by name.

    After a kill, the same call resumes. `engine` is as `build` takes it; all processes see `work`
    and the datasets. `again`: whether stale cells are deleted and run again; StaleCellError
    otherwise.
    """
    remove_stale(cells, work, again=again)
    waiting = [cell for cell in cells if not cell.is_done(cell.folder(work))]
    if not waiting:
        return {}
    total = sum(cell.n_updates for cell in waiting)
    n_done = sum(count_updates(cell, cell.folder(work)) for cell in waiting)
    failures = Failures(len(waiting))
    jobs = []
    for cell in longest_first(waiting, work):
        folder = str(cell.folder(work).resolve())  # for processes elsewhere
        jobs.append(Job(cell.name, {"cell": cell.model_dump(mode="json"), "folder": folder}))
    with (
        tqdm(total=total, initial=n_done, unit="update", unit_scale=True, desc="cells",
             disable=None if progress else True) as bar,  # None: unless there is a terminal
        open_engine(engine, WORKER, n_workers=min(workers, len(jobs)), folder=work, renews=True)
        as opened,
    ):  # fmt: skip

        def report(updates: int) -> None:
            bar.update(updates)

        def fail(job: Job, error: BuildError) -> None:
            failures.note(job.name, error)
            if progress:
                details = Path(job.payload["folder"]) / ERROR_FILE
                where = f" (more in {details})" if details.exists() else ""
                reason = failures.reasons[job.name]
                tqdm.write(f"{job.name} failed: {reason}{where}", file=sys.stderr)

        opened.run(jobs, report, fail)
    return failures.reasons


def remove_stale(cells: Sequence[Cell], work: Path, *, again: bool) -> None:
    """Deletes folders that hold a cell of the same name with another configuration."""
    found = [(cell, cell.conflict(cell.folder(work))) for cell in cells]
    stale = [(cell, why) for cell, why in found if why is not None]
    if stale and not again:
        lines = [f"{cell.name} ({why})" for cell, why in stale]
        n_hidden = len(lines) - MAX_SHOWN_STALE
        more = f" and {n_hidden} more" if n_hidden > 0 else ""
        raise StaleCellError(
            f"{work} has results of another configuration: "
            f"{'; '.join(lines[:MAX_SHOWN_STALE])}{more}. Pass --again to delete these cells and "
            "run them again, or name another folder to keep them."
        )
    for cell, _ in stale:
        folder = cell.folder(work)
        with locked(folder):  # waits for a process that is running the cell
            if cell.conflict(folder) is not None:  # that process may have run this very cell
                for part in filter(Path.is_dir, folder.iterdir()):  # `cell.json` goes after them
                    shutil.rmtree(part)
                shutil.rmtree(folder)


def count_updates(cell: Cell, folder: Path) -> int:
    """Updates that a cell had made when it stopped, read from the last row of its losses."""
    file = cell.run_in(folder) / LOSSES
    if not file.exists():
        return 0
    first = file.read_text(encoding="utf-8").rstrip().rpartition("\n")[2].partition(",")[0]
    return int(first) if first.isdecimal() else 0


def longest_first(cells: Sequence[Cell], work: Path) -> list[Cell]:
    """Sorts cells by their expected time, longest first, so that no core idles at the end.

    The time of an update is taken from finished cells of the same label. A label without any gets
    the longest known time, so that it starts early.
    """
    known: dict[str, list[float]] = {}  # seconds per update
    for file in sorted((work / "cells").glob(f"*/*/{COST_FILE}")):
        if speed := Cost.from_file(file).updates_per_second:
            known.setdefault(file.parent.parent.name, []).append(1.0 / speed)
    speeds = {label: sum(values) / len(values) for label, values in known.items()}
    slowest = max(speeds.values(), default=1.0)

    def seconds(cell: Cell) -> float:
        return cell.n_updates * speeds.get(cell.label, slowest)

    return sorted(cells, key=seconds, reverse=True)
