"""Runs the cells of a study, each in a fresh process; what is done is kept, what fails is told."""

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
from swarmdata.evaluation.study.cells.cell_worker import (
    COST,
    ERROR,
    claimed_by_other,
    is_done,
    run_of,
)
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.learn.training.run_files import LOSSES
from swarmdata.runtime.locking import locked
from swarmdata.runtime.workers import Crew, Job

WORKER = "swarmdata.evaluation.study.cells.cell_worker:work"


def folder_of(work: Path, cell: Cell) -> Path:
    """Where a study keeps a cell."""
    return work / "cells" / cell.label / cell.data


def chosen(cells: Sequence[Cell], pattern: str | None) -> list[Cell]:
    """The cells whose names match, such as `bc/*`; all of them for None.

    Raises:
        UnknownNameError: none does.
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
    """Does what is missing of the cells; the same call goes on after any kill.

    Args:
        cells: of a study.
        work: the study's folder of cells.
        workers: processes, each with one thread.
        again: whether stale cells are removed and done again.
        progress: whether to show one bar (on standard error, if that is a terminal).

    Returns:
        the reasons of cells that failed, by name.

    Raises:
        StaleCellError: a folder holds a cell of another key, and `again` is false.
    """
    remove_stale(cells, work, again=again)
    waiting = [cell for cell in cells if not is_done(cell, folder_of(work, cell))]
    if not waiting:
        return {}
    total = sum(cell.n_updates for cell in waiting)
    there = sum(updates_of(cell, folder_of(work, cell)) for cell in waiting)
    hidden = None if progress else True  # None: hidden where there is no terminal
    with tqdm(
        total=total, initial=there, unit="update", unit_scale=True, desc="cells", disable=hidden
    ) as bar:
        return _Shift(longest_first(waiting, work), work, bar, progress).finish(workers)


def remove_stale(cells: Sequence[Cell], work: Path, *, again: bool) -> None:
    """Removes the folders of other cells than these, if that is wanted.

    Raises:
        StaleCellError: it is not.
    """
    found = [(cell, claimed_by_other(cell, folder_of(work, cell))) for cell in cells]
    stale = [(cell, why) for cell, why in found if why is not None]
    if stale and not again:
        lines = [f"{cell.name} ({why})" for cell, why in stale]
        more = "" if len(lines) <= 3 else f" and {len(lines) - 3} more"
        raise StaleCellError(
            f"{work} has results of another configuration: {'; '.join(lines[:3])}{more}. "
            "--again removes these cells and does them anew; another --work keeps them."
        )
    for cell, _ in stale:
        with locked(folder_of(work, cell)):  # whoever works on it is waited for
            shutil.rmtree(folder_of(work, cell))


def updates_of(cell: Cell, folder: Path) -> int:
    """Updates that a killed cell has made, by the last row of its losses; 0 if there is none."""
    file = run_of(cell, folder) / LOSSES
    if not file.exists():
        return 0
    first = file.read_text(encoding="utf-8").rstrip().rpartition("\n")[2].partition(",")[0]
    return int(first) if first.isdecimal() else 0


def longest_first(cells: Sequence[Cell], work: Path) -> list[Cell]:
    """Cells by the time that they will take, longest first, so that no core idles at the end.

    The time of an update is that of another cell of the same label, else the longest known: what is
    not known begins early.
    """
    speeds = known_speeds(work)
    slowest = max(speeds.values(), default=1.0)

    def seconds(cell: Cell) -> float:
        return cell.n_updates * speeds.get(cell.label, slowest)

    return sorted(cells, key=seconds, reverse=True)


def known_speeds(work: Path) -> dict[str, float]:
    """Seconds of an update by label, of cells that have trained here."""
    found: dict[str, list[float]] = {}
    for file in sorted((work / "cells").glob(f"*/*/{COST}")):
        speed = Cost.from_file(file).updates_per_second
        if speed:
            found.setdefault(file.parent.parent.name, []).append(1.0 / speed)
    return {label: sum(values) / len(values) for label, values in found.items()}


@dataclass
class _Shift:
    """Threads that take cells from a queue, each waiting for the process that does its cell."""

    cells: Sequence[Cell]
    work: Path
    bar: "tqdm[Any]"
    is_told: bool
    failures: dict[str, str] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def finish(self, workers: int) -> dict[str, str]:
        """Does all cells; returns why which ones failed."""
        waiting: queue.SimpleQueue[Cell] = queue.SimpleQueue()
        for cell in self.cells:
            waiting.put(cell)
        # daemons: after Ctrl-C this process ends, and with it, soon, the workers, which find
        # nobody to report to
        threads = [
            threading.Thread(target=self._take, args=(waiting,), daemon=True)
            for _ in range(min(workers, len(self.cells)))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return self.failures

    def _take(self, waiting: "queue.SimpleQueue[Cell]") -> None:
        while True:
            try:
                cell = waiting.get_nowait()
            except queue.Empty:
                return
            self._do(cell)

    def _do(self, cell: Cell) -> None:
        """One cell in a new process, so that its memory is its own; killed ones are retried."""
        folder = folder_of(self.work, cell)
        job = Job(cell.name, {"cell": cell.model_dump(mode="json"), "folder": str(folder)})
        try:
            with Crew(WORKER, 1) as crew:
                crew.run([job], self._report)
        except BuildError as error:
            reason = str(error).removeprefix(f"{cell.name} failed: ").removeprefix("BuildError: ")
            self._note(cell, folder, reason)

    def _report(self, updates: int) -> None:
        with self.lock:
            self.bar.update(updates)

    def _note(self, cell: Cell, folder: Path, reason: str) -> None:
        with self.lock:
            self.failures[cell.name] = reason
            if self.is_told:
                details = folder / ERROR
                where = f" (more in {details})" if details.exists() else ""
                tqdm.write(f"{cell.name} failed: {reason}{where}", file=sys.stderr)
