"""The studies that are part of this installation, `cards/studies`, and their estimates."""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from importlib.resources.abc import Traversable

from swarmdata.errors import StudyError
from swarmdata.runtime.documents import parse_document

ESTIMATES_FILE = "estimates.csv"  # of a study: one row per mean with its interval
PLAN_FILE = "study.yaml"

Means = Mapping[str, str]  # a row of estimates

TEXTS = ("label", "dataset", "rewards", "digest", "quantity", "updates")
COUNTS = ("seeds", "episodes")
NUMBERS = ("mean", "low", "high")


@dataclass(frozen=True)
class CommittedStudy:
    """A finished study."""

    folder: Traversable  # with its plan and its tables
    estimates: tuple[Means, ...]  # every mean with its interval

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name

    @cached_property
    def plan(self) -> Mapping[str, object]:
        """Its plan, as it was written.

        Raises:
            StudyError: it is no plan.
        """
        plan = self.folder.joinpath(PLAN_FILE)
        found = parse_document(plan.read_bytes(), str(plan))
        if not isinstance(found, dict) or "block" not in found:
            raise StudyError(f"{plan} names no `block` of seeds, expected the plan of a study.")
        return found

    @property
    def chose_settings(self) -> bool:
        """Whether it was measured on validation seeds, on which settings are chosen."""
        return self.plan["block"] == "validation"


@cache
def committed_studies() -> tuple[CommittedStudy, ...]:
    """The studies of this version of the worlds that are part of this installation, by name.

    Raises:
        StudyError: one of them cannot be read.
    """
    return read_studies(files("swarmdata.cards").joinpath("studies"))


def read_studies(place: Traversable) -> tuple[CommittedStudy, ...]:
    """Reads all studies of a folder, by name; folders without a plan are none.

    Raises:
        StudyError: one of them cannot be read.
    """
    folders = sorted((each for each in place.iterdir() if each.is_dir()), key=lambda it: it.name)
    marks = (PLAN_FILE, ESTIMATES_FILE)
    return tuple(
        read_study(folder)
        for folder in folders
        if any(folder.joinpath(name).is_file() for name in marks)
    )


def read_study(folder: Traversable) -> CommittedStudy:
    """Reads the study of a folder.

    Raises:
        StudyError: it cannot be read.
    """
    for name in (PLAN_FILE, ESTIMATES_FILE):
        if not folder.joinpath(name).is_file():
            raise StudyError(f"the study {folder} has no {name}. `swarmdata study` writes it.")
    file = folder.joinpath(ESTIMATES_FILE)
    return CommittedStudy(folder, read_estimates(file.read_text(encoding="utf-8"), str(file)))


def read_estimates(text: str, source: str) -> tuple[Means, ...]:
    """Rows of an `estimates.csv`.

    Raises:
        StudyError: a column is missing, there is no row, or a value is no number.
    """
    reader = csv.DictReader(io.StringIO(text))
    rows = tuple(reader)
    missing = set(TEXTS + COUNTS + NUMBERS).difference(reader.fieldnames or ())
    if missing or not rows:
        what = f"no column {', '.join(sorted(missing))}" if missing else "no rows"
        raise StudyError(f"{source} has {what}. `swarmdata study FOLDER` writes it again.")
    for line, row in enumerate(rows, start=2):
        counts, numbers = (row[name] for name in COUNTS), (row[name] for name in NUMBERS)
        is_whole = all((each or "").isdecimal() for each in counts)
        if None in row.values() or not is_whole or not all(map(_is_number, numbers)):
            raise StudyError(
                f"{source}, line {line}, is no estimate: {dict(row)}. `swarmdata study FOLDER` "
                "writes it again."
            )
    return rows


def _is_number(text: str) -> bool:
    """Whether a text is empty, for what was not measured, or a finite number."""
    try:
        return not text or math.isfinite(float(text))
    except ValueError:
        return False
