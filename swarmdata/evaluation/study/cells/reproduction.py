"""Does one cell again from its record, elsewhere, and compares every number."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from swarmdata.errors import StudyError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.study.cells.cell_worker import DONE, RESULTS, read_cell, run_of
from swarmdata.evaluation.study.cells.run_cells import run_cells
from swarmdata.learn.training.run_files import LOSSES
from swarmdata.learn.training.run_folder import read_table
from swarmdata.specs.frozen import Frozen
from swarmdata.types import Double

Rows = list[dict[str, float]]


class Comparison(Frozen):
    """The same cell done twice."""

    cell: str
    key: str
    n_values: int  # of results: seeds times episodes times metrics
    n_different: int
    largest: float  # difference of two values, 0 if all are the same
    first_update: int | None  # at which a loss differs; None: never, or nothing was trained

    @property
    def is_same(self) -> bool:
        """Whether results and losses are the same bits."""
        return self.n_different == 0 and self.first_update is None

    def sentence(self) -> str:
        """What was found, in words."""
        if self.is_same:
            return f"{self.cell}: all {self.n_values:,} values and all losses are the same."
        where = "never" if self.first_update is None else f"first at update {self.first_update:,}"
        return (
            f"{self.cell}: {self.n_different:,} of {self.n_values:,} values differ, by "
            f"{self.largest:g} at most; losses differ {where}. The same bits are promised on the "
            "same machine with the same versions only."
        )


def check_cell(folder: Path, *, progress: bool = True) -> Comparison:
    """Does a finished cell again in a temporary folder, from its recorded configuration.

    Args:
        folder: the cell's.
        progress: whether to show a bar.

    Raises:
        StudyError: the cell is not finished, or fails now.
    """
    if not (folder / DONE).exists():
        raise StudyError(f"{folder} holds no finished cell. Run the study first.")
    cell = read_cell(folder)
    with tempfile.TemporaryDirectory(prefix="swarmdata-check-") as temporary:
        failures = run_cells([cell], Path(temporary), workers=1, progress=progress)
        if failures:
            raise StudyError(f"{cell.name} fails when it is done again: {failures[cell.name]}")
        again = Path(temporary) / "cells" / cell.label / cell.data
        differences = _result_differences(folder / RESULTS, again / RESULTS)
        first = _first_difference(run_of(cell, folder) / LOSSES, run_of(cell, again) / LOSSES)
    return Comparison(
        cell=cell.name,
        key=cell.key,
        n_values=len(differences),
        n_different=int((differences > 0).sum()),
        largest=float(differences.max(initial=0.0)),
        first_update=first,
    )


def _result_differences(one: Path, other: Path) -> Double:
    """Absolute differences of all values; of one that only one side defines, infinity."""
    found = []
    for file in sorted(one.glob("*.json")):
        ours, theirs = load_result(file), load_result(other / file.name)
        for name, a in ours.evaluation.metrics.items():
            b = theirs.evaluation.metrics[name]
            both = np.isnan(a) & np.isnan(b)
            found.append(np.where(both, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf)))
    return np.concatenate(found)


def _first_difference(one: Path, other: Path) -> int | None:
    if not one.exists():
        return None
    read: Callable[[Path], Rows] = read_table
    pairs = zip(read(one), read(other), strict=True)
    return next((int(a["update"]) for a, b in pairs if a != b), None)
