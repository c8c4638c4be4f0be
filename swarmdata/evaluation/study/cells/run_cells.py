"""Runs the cells of a study, each in a fresh process; a failed cell does not stop the others."""

import queue
import shutil
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from tqdm import tqdm

from swarmdata.errors import BuildError, StaleCellError, UnknownNameError
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cell_folder import (
    COST_FILE,
    ERROR_FILE,
    cell_folder,
    cell_run_folder,
    find_conflict,
    is_done,
)
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.learn.training.run_files import LOSSES
from swarmdata.runtime.locking import locked
from swarmdata.runtime.workers import Crew, Job

MAX_SHOWN_STALE = 3
"""Stale cells that an error message names; more are counted."""

WORKER = "swarmdata.evaluation.study.cells.cell_worker:serve_cells"


def select_cells(cells: Sequence[Cell], pattern: str | None) -> list[Cell]:
    """Returns the cells whose names match a pattern such as `bc/*`; all of them for None.

    Raises:
        UnknownNameError: no name matches.
    """
    found = [cell for cell in cells if pattern is None or fnmatch(cell.name, pattern)]
    if not found and pattern is not None:
        raise UnknownNameError("cell", pattern, [cell.name for cell in cells])
    return found


def run_cells(
    cells: Sequence[Cell],
    work: Path,
    *,
    workers: int = 2,
    again: bool = False,
    progress: bool = True,
) -> dict[str, str]:
    """Runs the cells that are not done yet; after a kill, the same call resumes.

    Args:
        cells: of a study.
        work: the study's folder of cells.
        workers: processes, each with one thread.
        again: whether stale cells are deleted and run again.
        progress: whether to show a progress bar on standard error, if that is a terminal.

    Returns:
        Why cells failed, by name.

    Raises:
        StaleCellError: a folder holds a cell of another key, and `again` is false.
    """
    remove_stale(cells, work, again=again)
    waiting = [cell for cell in cells if not is_done(cell, cell_folder(work, cell))]
    if not waiting:
        return {}
    total = sum(cell.n_updates for cell in waiting)
    n_done = sum(count_updates(cell, cell_folder(work, cell)) for cell in waiting)
    hidden = None if progress else True  # None: hidden unless there is a terminal
    with tqdm(
        total=total, initial=n_done, unit="update", unit_scale=True, desc="cells", disable=hidden
    ) as bar:
        return _CellQueue(longest_first(waiting, work), work, bar, progress).run(workers)


def remove_stale(cells: Sequence[Cell], work: Path, *, again: bool) -> None:
    """Deletes folders that hold a cell of the same name with another configuration.

    Raises:
        StaleCellError: there are such folders, and `again` is false.
    """
    found = [(cell, find_conflict(cell, cell_folder(work, cell))) for cell in cells]
    stale = [(cell, why) for cell, why in found if why is not None]
    if stale and not again:
        lines = [f"{cell.name} ({why})" for cell, why in stale]
        n_hidden = len(lines) - MAX_SHOWN_STALE
        more = f" and {n_hidden} more" if n_hidden > 0 else ""
        raise StaleCellError(
            f"{work} has results of another configuration: "
            f"{'; '.join(lines[:MAX_SHOWN_STALE])}{more}. Pass --again to delete these cells and "
            "run them again, or another --work to keep them."
        )
    for cell, _ in stale:
        with locked(cell_folder(work, cell)):  # waits for a process that is running the cell
            shutil.rmtree(cell_folder(work, cell))


def count_updates(cell: Cell, folder: Path) -> int:
    """Updates that a cell had made when it stopped, read from the last row of its losses."""
    file = cell_run_folder(cell, folder) / LOSSES
    if not file.exists():
        return 0
    first = file.read_text(encoding="utf-8").rstrip().rpartition("\n")[2].partition(",")[0]
    return int(first) if first.isdecimal() else 0


def longest_first(cells: Sequence[Cell], work: Path) -> list[Cell]:
    """Sorts cells by their expected time, longest first, so that no core idles at the end.

    The time of an update is taken from finished cells of the same label. A label without any gets
    the longest known time, so that it starts early.
    """
    speeds = known_speeds(work)
    slowest = max(speeds.values(), default=1.0)

    def seconds(cell: Cell) -> float:
        return cell.n_updates * speeds.get(cell.label, slowest)

    return sorted(cells, key=seconds, reverse=True)


def known_speeds(work: Path) -> dict[str, float]:
    """Seconds per update by label, from cells that were trained in this folder."""
    found: dict[str, list[float]] = {}
    for file in sorted((work / "cells").glob(f"*/*/{COST_FILE}")):
        speed = Cost.from_file(file).updates_per_second
        if speed:
            found.setdefault(file.parent.parent.name, []).append(1.0 / speed)
    return {label: sum(values) / len(values) for label, values in found.items()}


@dataclass
class _CellQueue:
    """Threads that take cells from a queue; each waits for the process that runs its cell."""

    cells: Sequence[Cell]
    work: Path
    bar: "tqdm[Any]"
    prints_failures: bool
    failures: dict[str, str] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def run(self, workers: int) -> dict[str, str]:
        """Runs all cells; returns the reasons of failures by the cell's name."""
        waiting: queue.SimpleQueue[Cell] = queue.SimpleQueue()
        for cell in self.cells:
            waiting.put(cell)
        # daemons: after Ctrl-C this process ends, and the workers end soon after, because their
        # next report fails
        threads = [
            threading.Thread(target=self._run_waiting, args=(waiting,), daemon=True)
            for _ in range(min(workers, len(self.cells)))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return self.failures

    def _run_waiting(self, waiting: "queue.SimpleQueue[Cell]") -> None:
        while True:
            try:
                cell = waiting.get_nowait()
            except queue.Empty:
                return
            self._run(cell)

    def _run(self, cell: Cell) -> None:
        """Runs a cell in a new process, which frees its memory; a killed process is retried."""
        folder = cell_folder(self.work, cell)
        job = Job(cell.name, {"cell": cell.model_dump(mode="json"), "folder": str(folder)})
        try:
            with Crew(WORKER, 1) as crew:
                crew.run([job], self._report)
        except BuildError as error:
            reason = str(error).removeprefix(f"{cell.name} failed: ").removeprefix("BuildError: ")
            self._record_failure(cell, folder, reason)

    def _report(self, updates: int) -> None:
        with self.lock:
            self.bar.update(updates)

    def _record_failure(self, cell: Cell, folder: Path, reason: str) -> None:
        with self.lock:
            self.failures[cell.name] = reason
            if self.prints_failures:
                details = folder / ERROR_FILE
                where = f" (more in {details})" if details.exists() else ""
                tqdm.write(f"{cell.name} failed: {reason}{where}", file=sys.stderr)
