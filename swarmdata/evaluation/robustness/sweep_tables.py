"""What a robustness sweep found along its axes, as Markdown and as tidy CSV."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column, Row, Table
from swarmdata.rollouts.score_statistics import Estimate

HEAD = (
    "part",
    "parameter",
    "value",
    "as_trained",
    "policy",
    "runs",
    "episodes",
    "metric",
    "estimate",
    "low",
    "high",
)
"""Columns of the CSV; values in stored units, empty where undefined or unlimited."""


FEW = 5
"""Training seeds below which a bootstrap over them covers much less than it says: of two, half."""


@dataclass(frozen=True, slots=True)
class Point:
    """What one team achieved at one value of an axis."""

    value: float | None  # None: as trained, where that is no number
    is_trained: bool  # whether everything is as in training
    estimates: tuple[Estimate, ...]  # one per column; NaN where nothing is defined


@dataclass(frozen=True, slots=True)
class Line:
    """One team along an axis."""

    label: str
    n_runs: int  # policies, one per training seed
    points: tuple[Point, ...]  # in the order of the axis; as trained among them, or first

    @property
    def on_axis(self) -> tuple[Point, ...]:
        """The points that have a value."""
        return tuple(point for point in self.points if point.value is not None)

    @property
    def trained(self) -> Point:
        """What it achieved with everything as in training."""
        return next(point for point in self.points if point.is_trained)


@dataclass(frozen=True, slots=True)
class Degradation:
    """Several teams along one axis, on the same episodes."""

    part: str
    name: str  # of the parameter
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    n_episodes: int
    falls: bool  # whether the values of the axis fall from left to right

    def column(self, key: str) -> int:
        """Index of a column.

        Raises:
            UnknownNameError: there is none with that key.
        """
        known = {column.key: index for index, column in enumerate(self.columns)}
        if key not in known:
            raise UnknownNameError("column", key, known)
        return known[key]

    def to_markdown(self) -> str:
        """A heading and a table with a row for each team and value."""
        rows = tuple(
            Row(f"{line.label}, {_words(self.name, point)}", line.n_runs, point.estimates)
            for line in self.lines
            for point in line.points
        )
        table = Table(self.columns, rows, self._caption())
        return f"## {self.part} {self.name}\n\n{table.to_markdown()}"

    def _caption(self) -> str:
        several = any(line.n_runs > 1 for line in self.lines)
        few = any(1 < line.n_runs < FEW for line in self.lines)
        single = any(line.n_runs == 1 for line in self.lines)
        ways = [
            "interquartile mean over training seeds [95 % bootstrap over seeds"
            f"{', too narrow with so few' * few}]" * several,
            "of one policy, mean [95 % interval over episodes]" * single,
        ]
        return (
            f"Only {self.part} {self.name} changes; everything else is as each policy was trained. "
            f"The same {self.n_episodes} evaluation seeds at every point; "
            f"{'; '.join(way for way in ways if way)}. Collisions are contacts that began, per "
            "episode. Time to goal counts an unsolved episode as the horizon. The change is from "
            "what the same policies achieve as trained, seed by seed and episode by episode."
        )


def _words(name: str, point: Point) -> str:
    if point.value is None:
        return "as trained"
    return f"{name} {point.value:g}{' (as trained)' if point.is_trained else ''}"


def to_csv(found: Sequence[Degradation]) -> str:
    """Every estimate of every axis at full precision, one in a row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEAD)
    for each in found:
        writer.writerows(_rows(each))
    return out.getvalue()


def _rows(found: Degradation) -> Iterator[list[str]]:
    for line in found.lines:
        for point in line.points:
            value = "" if point.value is None else repr(point.value)
            where = [found.part, found.name, value, str(int(point.is_trained)), line.label]
            where += [str(line.n_runs), str(found.n_episodes)]
            for column, estimate in zip(found.columns, point.estimates, strict=True):
                cells = ("" if math.isnan(number) else repr(number) for number in estimate)
                yield [*where, column.key, *cells]
