"""The estimates of a robustness sweep along its axes, as Markdown and as CSV."""

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.estimate_table import Column, Row, Table, to_csv
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case, reference_of
from swarmdata.evaluation.results.result_tables import QUANTITIES, case_table
from swarmdata.numerics.random import SeedBlock
from swarmdata.registry.published import Reference, normalized_score
from swarmdata.rollouts.score_intervals import mean_interval, target_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.task_spec import TaskSpec

SWEEP_FILE = "sweep.csv"


@dataclass(frozen=True, slots=True)
class Point:
    """The estimates of a team at one value of an axis."""

    value: float | None  # None: that of the base, if it has no number
    is_trained: bool  # whether it is the base, in which nothing has been varied
    estimates: tuple[Estimate, ...]  # one per column; NaN if undefined


@dataclass(frozen=True, slots=True)
class TeamLine:
    """One team along an axis."""

    label: str
    n_runs: int  # policies, one per training seed
    points: tuple[Point, ...]  # in the order of the axis; the trained one is among them, or first

    @property
    def on_axis(self) -> tuple[Point, ...]:
        """The points that have a value."""
        return tuple(point for point in self.points if point.value is not None)

    @property
    def trained(self) -> Point:
        """The base: as in training, or as the sweep was asked to begin."""
        return next(point for point in self.points if point.is_trained)


@dataclass(frozen=True, slots=True)
class Degradation:
    """Several teams along one axis, on the same episodes."""

    part: str
    name: str  # of the parameter
    columns: tuple[Column, ...]
    lines: tuple[TeamLine, ...]
    n_episodes: int
    falls: bool  # whether the values of the axis fall from left to right
    as_trained: bool = True  # whether the teams' worlds are those of their training
    block: SeedBlock = "evaluation"  # of the episodes' seeds

    @property
    def base(self) -> str:
        """What the worlds are called in which nothing has been varied."""
        return "as trained" if self.as_trained else "not varied"

    def column(self, key: str) -> int:
        """Returns the index of a column; raises UnknownNameError if there is none."""
        known = {column.key: index for index, column in enumerate(self.columns)}
        if key not in known:
            raise UnknownNameError("column", key, known)
        return known[key]

    def to_markdown(self) -> str:
        """A heading and a table with a row for each team and value."""
        rows = tuple(
            Row(f"{line.label}, {self._describe_value(point)}", line.n_runs, point.estimates)
            for line in self.lines
            for point in line.points
        )
        table = Table(self.columns, rows, self._caption())
        return f"## {self.part} {self.name}\n\n{table.to_markdown()}"

    def _caption(self) -> str:
        target = target_of([line.n_runs for line in self.lines])
        rest = "the training of each policy" if self.as_trained else "the world that was asked for"
        return (
            f"Only {self.part} {self.name} changes; everything else is as in {rest}. All points "
            f"have the same {self.n_episodes} {self.block} seeds; mean [95 % interval for "
            f"{target}]. Collisions are new contacts per episode. Time to goal counts an unsolved "
            f"episode as the horizon. The change is from the same policies {self.base}, paired by "
            "training seed and episode."
        )

    def _describe_value(self, point: Point) -> str:
        if point.value is None:
            return self.base
        return f"{self.name} {point.value:g}{f' ({self.base})' if point.is_trained else ''}"


def estimates_of(
    runs: Sequence[Result], before: Sequence[Result], spec: TaskSpec, trained: TaskSpec
) -> tuple[tuple[Column, ...], tuple[Estimate, ...]]:
    """Returns the columns of `result_tables.case_table`, and the change compared with training.

    There is one result per policy of a team at the point, and before, with everything as in
    training. The references of the training's spec scale the score: a world with other sensors on
    the robots has no references.
    """
    scale = reference_of(trained)
    label = runs[0].provenance.label
    table = case_table(Case(None, spec, scale, None, {label: tuple(runs)}))
    change = change_column("return" if scale is None else "score")
    estimates = (*table.rows[0].estimates, change_of(runs, before, scale))
    return (*table.columns, change), estimates


def change_column(key: str) -> Column:
    """The column of the change of a quantity since training."""
    return Column(f"{key}_change", f"change of {key}", "", QUANTITIES[key].column.decimals)


def change_of(
    runs: Sequence[Result], before: Sequence[Result], scale: Reference | None
) -> Estimate:
    """Returns the difference of scores, or of returns without a scale, with its 95 % interval.

    Differences are paired by training seed and episode: both have one result per policy, on the
    same seeds. Variation between seeds and episodes cancels, so the interval is narrower than those
    of the two scores.
    """
    sides = (
        np.stack([each.evaluation.metrics["return"] for each in side]) for side in (runs, before)
    )
    after, then = (side if scale is None else normalized_score(side, scale) for side in sides)
    return mean_interval(after - then)  # [runs, episodes]


def write_csv(found: Sequence[Degradation]) -> str:
    """Writes all estimates of all axes at full precision and in stored units, one per row.

    Values are empty where they are undefined or unlimited.
    """
    return to_csv([row for each in found for row in _rows(each)], "")


def _rows(found: Degradation) -> Iterator[dict[str, object]]:
    for line in found.lines:
        for point in line.points:
            for column, estimate in zip(found.columns, point.estimates, strict=True):
                yield {
                    "part": found.part,
                    "parameter": found.name,
                    "value": point.value,
                    "as_trained": int(point.is_trained),
                    "policy": line.label,
                    "runs": line.n_runs,
                    "episodes": found.n_episodes,
                    "metric": column.key,
                    **dict(zip(("estimate", "low", "high"), estimate, strict=True)),
                }


def read_csv(file: Path) -> Degradation:
    """Reads the table of one axis that `write_csv` wrote."""
    with file.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    estimates: dict[tuple[str, str, str], dict[str, Estimate]] = {}
    for row in rows:
        ends = (float(row[name] or math.nan) for name in ("estimate", "low", "high"))
        place = row["policy"], row["value"], row["as_trained"]
        estimates.setdefault(place, {})[row["metric"]] = Estimate(*ends)
    runs = {row["policy"]: int(row["runs"]) for row in rows}
    lines = tuple(
        TeamLine(
            policy,
            n_runs,
            tuple(
                Point(float(value) if value else None, is_trained == "1", tuple(found.values()))
                for (label, value, is_trained), found in estimates.items()
                if label == policy
            ),
        )
        for policy, n_runs in runs.items()
    )
    changes = {each.key: each for each in map(change_column, ("score", "return"))}
    known = {**{key: each.column for key, each in QUANTITIES.items()}, **changes}
    columns = tuple(known[key] for key in dict.fromkeys(row["metric"] for row in rows))
    first, *_, last = lines[0].on_axis
    return Degradation(
        rows[0]["part"], rows[0]["parameter"], columns, lines, int(rows[0]["episodes"]),
        falls=float(last.value or 0.0) < float(first.value or 0.0),
    )  # fmt: skip
