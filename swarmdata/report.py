"""Turns evaluation results into one table, as Markdown, CSV or aligned text.

All numbers are written by `format_number` and `format_estimate`.
"""

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swarmdata import metrics
from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.evaluate import check_comparable
from swarmdata.metrics import Estimate, Reference, normalized_score
from swarmdata.models import describe
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, EvalResult

PerEpisode = Callable[[EvalResult], Double]


@dataclass(frozen=True, slots=True)
class Column:
    """What a column shows and how its numbers are written."""

    key: str  # in CSV
    label: str
    unit: str  # empty if there is none
    decimals: int
    factor: float = 1.0  # from the stored value to the shown one: 100 for percentages
    is_rate: bool = False  # a share of episodes, whose interval is the binomial one

    @property
    def header(self) -> str:
        """Label with unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True, slots=True)
class Row:
    """One policy or algorithm."""

    label: str
    n_runs: int
    estimates: tuple[Estimate, ...]  # one per column; NaN where nothing is defined


@dataclass(frozen=True, slots=True)
class Table:
    """Estimates of several policies on the same episodes."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    caption: str

    def to_markdown(self) -> str:
        """A GitHub table with the caption below it."""
        grid = [_escaped(line) for line in self._grid()]
        rule = ["---"] + ["---:"] * (len(grid[0]) - 1)
        lines = [f"| {' | '.join(line)} |" for line in (grid[0], rule, *grid[1:])]
        return "\n".join([*lines, "", self.caption, ""])

    def to_text(self) -> str:
        """Columns aligned with spaces, for a terminal, with the caption below."""
        grid = self._grid()
        widths = [max(len(line[c]) for line in grid) for c in range(len(grid[0]))]
        lines = [
            "  ".join(
                cell.rjust(width) if c else cell.ljust(width)
                for c, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in grid
        ]
        return "\n".join(
            [lines[0], "─" * (sum(widths) + 2 * len(widths) - 2), *lines[1:], "", self.caption, ""]
        )

    def to_csv(self) -> str:
        """Every value and interval end at full precision, in stored units; undefined is empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        ends = ("", "_low", "_high")
        writer.writerow(["policy", "runs", *(c.key + end for c in self.columns for end in ends)])
        for row in self.rows:
            values = [v for estimate in row.estimates for v in estimate]
            cells = ["" if math.isnan(value) else repr(value) for value in values]
            writer.writerow([row.label, row.n_runs, *cells])
        return out.getvalue()

    def panels(self, keys: Sequence[str]) -> dict[str, dict[str, Estimate]]:
        """Chosen columns in shown units, for `plots.plot_estimates`: header -> row -> estimate.

        Raises:
            UnknownNameError: the table has no such column.
        """
        known = {column.key: index for index, column in enumerate(self.columns)}
        chosen = {}
        for key in keys:
            if key not in known:
                raise UnknownNameError("column", key, known)
            column = self.columns[known[key]]
            chosen[column.header] = {
                row.label: Estimate(*(column.factor * v for v in row.estimates[known[key]]))
                for row in self.rows
            }
        return chosen

    def _grid(self) -> list[list[str]]:
        """The cells as text, header first; the number of runs only where some row has several."""
        has_runs = any(row.n_runs > 1 for row in self.rows)
        head = ["policy", *(["runs"] if has_runs else []), *(c.header for c in self.columns)]
        body = [
            [
                row.label,
                *([str(row.n_runs)] if has_runs else []),
                *(format_estimate(e, c) for e, c in zip(row.estimates, self.columns, strict=True)),
            ]
            for row in self.rows
        ]
        return [head, *body]


def format_number(value: float, column: Column) -> str:
    """A number in the column's shown unit and decimals; an undefined one is a dash."""
    if math.isnan(value):
        return "–"
    text = f"{value * column.factor:.{column.decimals}f}"
    return text.removeprefix("-") if not float(text) else text  # no negative zero


def format_estimate(estimate: Estimate, column: Column) -> str:
    """`value [low, high]`; only a dash if undefined."""
    value, low, high = (format_number(number, column) for number in estimate)
    return value if math.isnan(estimate.value) else f"{value} [{low}, {high}]"


def results_table(
    results: Mapping[str, Sequence[EvalResult]],
    spec: TaskSpec,
    *,
    reference: Reference | None = None,
    generator: np.random.Generator | None = None,
    n_resamples: int = 2000,
) -> Table:
    """Compares policies, one row per label.

    A label with one result gets the mean over episodes; its 95 % interval is Wilson's for shares of
    episodes and a percentile bootstrap over episodes for the rest. A label with several results,
    one per training seed, gets the interquartile mean over their means, with a stratified bootstrap
    over seeds. Time to goal counts an unsolved episode as the horizon (`restricted_mean_time`).

    Args:
        results: label -> one result per training seed, in the order of the rows.
        spec: the spec that all were evaluated on.
        reference: adds the score column.
        generator: source of the bootstrap; a fixed one by default, so that a table is repeatable.
        n_resamples: of each bootstrap.

    Raises:
        SchemaError: a label has no result, or the results are not of `spec` and the same seeds.
    """
    for label, runs in results.items():
        if not runs:
            raise SchemaError(f"{label!r} has no results. Evaluate it or leave it out.")
    flat = [result for runs in results.values() for result in runs]
    check_comparable(flat)
    if flat[0].spec_hash != spec.hash():
        raise SchemaError(
            f"the results are of spec {flat[0].spec_hash[:12]}, the table of {spec.hash()[:12]}. "
            "They are stale or of another task: evaluate again."
        )
    rng = np.random.default_rng(0) if generator is None else generator
    columns = _columns(spec, reference)
    rows = [
        Row(
            label,
            len(runs),
            tuple(_estimate(runs, c, values, rng, n_resamples) for c, values in columns),
        )
        for label, runs in results.items()
    ]
    return Table(tuple(c for c, _ in columns), tuple(rows), _caption(flat, results, spec))


def _columns(spec: TaskSpec, reference: Reference | None) -> list[tuple[Column, PerEpisode]]:
    """The columns and the per-episode values that each of them averages."""
    limit = spec.horizon * spec.control_dt

    def metric(name: str) -> PerEpisode:
        return lambda result: result.metrics[name]

    columns: list[tuple[Column, PerEpisode]] = [
        (Column("return", "return", "", 2), metric("return")),
        (Column("success", "success", "%", 1, 100.0, is_rate=True), metric("success")),
        (
            Column("clean_success", "clean success", "%", 1, 100.0, is_rate=True),
            metric("clean_success"),
        ),
        (Column("robot_collisions", "robot collisions", "", 2), metric("robot_collisions")),
        (
            Column("obstacle_collisions", "obstacle collisions", "", 2),
            metric("obstacle_collisions"),
        ),
        (
            Column("time_to_goal", "time to goal", "s", 1),
            lambda result: metrics.censored_times(result.metrics["time_to_goal"], limit),
        ),
    ]
    if reference is not None:
        known = reference
        score = Column("score", "score", "", 1)
        columns.insert(0, (score, lambda r: normalized_score(r.metrics["return"], known)))
    return columns


def _estimate(
    runs: Sequence[EvalResult],
    column: Column,
    values: PerEpisode,
    generator: np.random.Generator,
    n_resamples: int,
) -> Estimate:
    samples = np.stack([values(run) for run in runs])  # [runs, episodes]
    if np.isnan(samples).any():
        return Estimate(math.nan, math.nan, math.nan)
    if len(runs) > 1:
        table = samples.mean(axis=1)[:, None]
        return metrics.bootstrap(metrics.iqm, table, generator=generator, n_resamples=n_resamples)
    if column.is_rate:
        return metrics.wilson_interval(int(samples.sum()), samples.size)
    return metrics.bootstrap(metrics.mean, samples.T, generator=generator, n_resamples=n_resamples)


def _caption(
    flat: Sequence[EvalResult], results: Mapping[str, Sequence[EvalResult]], spec: TaskSpec
) -> str:
    limit = spec.horizon * spec.control_dt
    several = any(len(runs) > 1 for runs in results.values())
    what = "Mean [95 % interval]" + (
        "; over several runs, interquartile mean [stratified bootstrap over runs]"
        if several
        else ""
    )
    return (
        f"{what}; {len(flat[0].seeds)} episodes of {spec.task} on the evaluation seeds, "
        f"{describe(spec)}, spec {spec.hash()[:12]}. Collisions are contacts that began, per "
        f"episode. Time to goal counts an unsolved episode as {limit:g} s."
    )


def _escaped(line: Sequence[str]) -> list[str]:
    """A pipe would end a Markdown cell."""
    return [cell.replace("|", "\\|") for cell in line]
