"""The folder of a cell: its files, whose cell it is, and whether that cell is done.

cell.json   the cell, written first; a folder of another cell is refused
data.json   what the episodes of its dataset achieved
LABEL/      the run folder, named like the algorithm's label; once trained, it keeps only policies
results/    one file per seed
cost.json   time, memory, speed
error.txt   the traceback, if the cell failed
done.json   written last: the cell's key, and the digests of its results
"""

import json
from pathlib import Path

from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.specs.frozen import describe_differences

CELL_FILE = "cell.json"
DATA_FILE = "data.json"
RESULTS_FOLDER = "results"
COST_FILE = "cost.json"
ERROR_FILE = "error.txt"
DONE_FILE = "done.json"


def cell_folder(work: Path, cell: Cell) -> Path:
    """Where a study keeps a cell, below its folder of runs and results."""
    return work / "cells" / cell.label / cell.data


def cell_run_folder(cell: Cell, folder: Path) -> Path:
    """The run folder of a cell; its name becomes the label of the policies."""
    return folder / cell.label


def is_done(cell: Cell, folder: Path) -> bool:
    """Whether the folder holds the complete results of this cell."""
    file = folder / DONE_FILE
    return file.exists() and json.loads(file.read_text(encoding="utf-8"))["key"] == cell.key


def read_cell(folder: Path) -> Cell:
    """Reads the cell that a folder belongs to."""
    return Cell.from_file(folder / CELL_FILE)


def find_conflict(cell: Cell, folder: Path) -> str | None:
    """How the folder's cell differs from this one; None if it is this one, or there is none yet."""
    if not (folder / CELL_FILE).exists():
        return None
    stored = read_cell(folder)
    if stored.key == cell.key:
        return None
    return describe_differences(stored, cell)
