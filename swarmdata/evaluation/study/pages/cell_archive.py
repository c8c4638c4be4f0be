"""One compressed file with everything that pages of a study are made from, but no policies.

Pages are always made from it, so that those that are made again from a study's folder are the same.
"""

import io
import json
import tarfile
from collections.abc import Iterator
from dataclasses import replace
from lzma import LZMAError
from pathlib import Path

from pydantic import Field

from swarmdata.errors import StudyError
from swarmdata.evaluation.runs.portable_names import without_places
from swarmdata.evaluation.study.cells.cells import (
    CELL_FILE,
    COST_FILE,
    DATA_FILE,
    DONE_FILE,
    RESULTS_FOLDER,
    Cell,
)
from swarmdata.evaluation.study.pages.collect_results import Findings, collect_findings
from swarmdata.evaluation.study.pages.study_tables import RUN_METRICS
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.run_files import CURVE, LOSSES
from swarmdata.specs.frozen import Frozen
from swarmdata.store import write_file

ARCHIVE_FILE = "cells.tar.xz"

NOTES_FILE = "notes.json"  # in the archive: what pages say beyond the cells

DECIMALS = 4  # of kept metrics: those that pages show


class Notes(Frozen):
    """What pages say beyond the cells."""

    command: str  # that runs the study again
    missing: dict[str, str]  # why other cells have no results, by name
    sweeps: dict[str, str] = Field(default_factory=dict, exclude=True)  # of older archives; unused


def write_archive(found: Findings, notes: Notes, file: Path) -> None:
    """Writes the archive of finished cells, the same bytes for the same cells."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w:xz") as archive:
        _add(archive, NOTES_FILE, notes.to_json().encode())
        for cell in sorted(found.cells, key=lambda cell: cell.name):
            for path in _files(found, cell):
                data = path.read_bytes()
                if path.parent.name == RESULTS_FOLDER:
                    data = _shortened(data)
                elif path.name == CELL_FILE:
                    data = Cell.parse(without_places(json.loads(data))).to_json().encode()
                _add(archive, path.relative_to(found.work).as_posix(), data)
    write_file(file, content.getvalue())


def _add(archive: tarfile.TarFile, name: str, data: bytes) -> None:
    entry = tarfile.TarInfo(name)  # without time and owner
    entry.size = len(data)
    archive.addfile(entry, io.BytesIO(data))


def _files(found: Findings, cell: Cell) -> Iterator[Path]:
    """What pages read of a cell; its losses only if the study draws some of that label."""
    folder = cell.folder(found.work)
    run = cell.run_in(folder)
    files = [folder / name for name in (CELL_FILE, DATA_FILE, COST_FILE, DONE_FILE)]
    files.append(run / CURVE)
    if any(cell.label in drawn.algorithms for drawn in found.study.losses.values()):
        files.append(run / LOSSES)
    yield from (path for path in files if path.exists())
    yield from sorted((folder / RESULTS_FOLDER).glob("*.json"))


def _shortened(result: bytes) -> bytes:
    """A result whose kept metrics are rounded, and whose other metrics are undefined."""
    document = json.loads(result)
    if document["provenance"]["run"] is not None:
        document["provenance"]["run"] = Path(document["provenance"]["run"]).name
    document["metrics"] = {
        name: [
            None if value is None or name not in RUN_METRICS else round(value, DECIMALS)
            for value in values
        ]
        for name, values in document["metrics"].items()
    }
    return json.dumps(document, separators=(",", ":")).encode()


def read_archive(study: Study, file: Path, folder: Path) -> tuple[Findings, Notes]:
    """Unpacks a study's archive into a folder of cells, and collects what they found.

    Raises:
        StudyError: the archive is damaged.
    """
    try:
        with tarfile.open(file, mode="r:xz") as archive:
            archive.extractall(folder, filter="data")
    except (tarfile.TarError, LZMAError, EOFError) as error:
        raise StudyError(
            f"{file} is damaged ({error}); restore it, or run the study from its plan"
        ) from error
    notes = Notes.from_file(folder / NOTES_FILE)
    cells = [Cell.in_folder(path.parent) for path in sorted(folder.glob(f"cells/*/*/{CELL_FILE}"))]
    found = collect_findings(study, cells, folder, {})
    return replace(found, missing=notes.missing), notes


def unpack_cell(file: Path, name: str, folder: Path) -> None:
    """Unpacks one cell of a study's archive into a folder of cells; nothing if it has none."""
    with tarfile.open(file, mode="r:xz") as archive:
        members = [each for each in archive if each.name.startswith(f"cells/{name}/")]
        archive.extractall(folder, members, filter="data")
