"""Runs a finished cell again from its record, in a temporary folder, and compares every number."""

import tempfile
from pathlib import Path

import numpy as np

from swarmdata.errors import StudyError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.study.cells.cells import DONE_FILE, RESULTS_FOLDER, Cell
from swarmdata.evaluation.study.cells.run_cells import run_cells
from swarmdata.learn.training.run_files import LOSSES, read_table
from swarmdata.specs.frozen import Frozen
from swarmdata.types import Double


class Comparison(Frozen):
    """Two runs of the same cell."""

    cell: str
    key: str
    n_values: int  # of results: seeds times episodes times metrics
    n_different: int
    largest_difference: float  # of two values that both runs define
    n_one_sided: int  # values that one run defines and the other does not, among the different
    first_differing_update: int | None  # of the losses; None: all are equal, or nothing was trained

    @property
    def is_same(self) -> bool:
        """Whether results and losses have the same bits."""
        return self.n_different == 0 and self.first_differing_update is None

    def sentence(self) -> str:
        """The comparison in words."""
        if self.is_same:
            return f"{self.cell}: all {self.n_values:,} values and all losses are the same."
        first, alone = self.first_differing_update, self.n_one_sided
        one_sided = f" (only one run defines {alone:,} of them)" if alone else ""
        losses = "losses are equal" if first is None else f"losses differ from update {first:,} on"
        return (
            f"{self.cell}: {self.n_different:,} of {self.n_values:,} values differ, by at most "
            f"{self.largest_difference:g}{one_sided}; {losses}. Equal bits are promised only on "
            "the same machine with the same versions."
        )


def reproduce_cell(folder: Path, *, progress: bool) -> Comparison:
    """Runs a finished cell again in a temporary folder, from its recorded configuration.

    Raises:
        StudyError: the cell is not finished, or fails this time.
    """
    if not (folder / DONE_FILE).exists():
        raise StudyError(f"{folder} holds no finished cell. Run the study first.")
    cell = Cell.in_folder(folder)
    with tempfile.TemporaryDirectory(prefix="swarmdata-check-") as temporary:
        failures = run_cells([cell], Path(temporary), workers=1, progress=progress)
        if failures:
            raise StudyError(f"{cell.name} failed when it was run again: {failures[cell.name]}")
        again = cell.folder(Path(temporary))
        differences = _result_differences(folder / RESULTS_FOLDER, again / RESULTS_FOLDER)
        first = _first_difference(cell.run_in(folder) / LOSSES, cell.run_in(again) / LOSSES)
    return Comparison(
        cell=cell.name,
        key=cell.key,
        n_values=len(differences),
        n_different=int((differences > 0).sum()),
        largest_difference=float(differences[np.isfinite(differences)].max(initial=0.0)),
        n_one_sided=int(np.isinf(differences).sum()),
        first_differing_update=first,
    )


def _result_differences(one: Path, other: Path) -> Double:
    """Absolute differences of all values; infinity for a value that only one side defines."""
    found = []
    for file in sorted(one.glob("*.json")):
        first, second = load_result(file).evaluation, load_result(other / file.name).evaluation
        for name, a in first.metrics.items():
            b = second.metrics[name]
            both_undefined = np.isnan(a) & np.isnan(b)
            found.append(np.where(both_undefined, 0.0, np.nan_to_num(np.abs(a - b), nan=np.inf)))
    return np.concatenate(found)


def _first_difference(one: Path, other: Path) -> int | None:
    """The first update whose losses differ."""
    if not one.exists():
        return None
    pairs = zip(read_table(one), read_table(other), strict=True)
    return next((int(a["update"]) for a, b in pairs if a != b), None)
