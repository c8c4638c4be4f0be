"""Tables of a result set: one case in detail, labels by dataset, aggregates, and comparisons."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from swarmdata.evaluation.results.aggregates import (
    ComparableScores,
    comparable_scores,
    differences,
    mean_over_datasets,
    optimality_gap,
)
from swarmdata.evaluation.results.estimate_table import Column, Row, Table
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.numerics.event_costs import COSTS
from swarmdata.numerics.random import VALIDATION_BASE
from swarmdata.rollouts import metrics
from swarmdata.rollouts.score_intervals import (
    AT_LEAST_ZERO,
    count_interval,
    mean_interval,
    rare_rate_interval,
    rate_interval,
    target_of,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.model_choice import describe
from swarmdata.specs.rules import words_of_rewards
from swarmdata.types import Double

UNDEFINED_ESTIMATE = Estimate(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Quantity:
    """A column, its values, and its mean over the dataset's own episodes."""

    column: Column
    figure: str = ""  # that mean in `Figures`; empty: unknown

    def values(self, case: Case, label: str) -> Double:
        """Of a label, [runs, episodes]; an unsolved episode counts as the horizon in times."""
        key = self.column.key
        if key == "score":
            return case.scores(label)
        found = case.metric(label, key)
        return metrics.censored_times(found, case.time_limit) if key == "time_to_goal" else found

    def data(self, case: Case) -> float | None:
        """Of the dataset's own episodes; None: unknown."""
        if self.column.key == "score":
            return case.data_score
        known = case.data is not None and self.figure
        return float(getattr(case.data, self.figure)) if known else None

    def limit(self, case: Case) -> float:
        """The largest value in a case."""
        if self.column.key == "time_to_goal":
            return case.time_limit
        steps = case.spec.horizon if self.column.key == "length" else None
        return steps or math.inf


SCORE = Quantity(Column("score", "score", "", 1))
RETURN = Quantity(Column("return", "return", "", 2), "mean_return")
SUCCESS = Quantity(Column("success", "success", "%", 1, 100.0, is_rate=True), "success")

QUANTITIES: Mapping[str, Quantity] = {
    each.column.key: each
    for each in (
        SCORE,
        RETURN,
        SUCCESS,
        Quantity(
            Column("clean_success", "clean success", "%", 1, 100.0, is_rate=True), "clean_success"
        ),
        Quantity(Column("robot_collisions", "robot collisions", "", 2, bounds=AT_LEAST_ZERO)),
        Quantity(Column("obstacle_collisions", "obstacle collisions", "", 2, bounds=AT_LEAST_ZERO)),
        Quantity(Column("time_to_goal", "time to goal", "s", 1, bounds=AT_LEAST_ZERO)),
    )
}
"""The quantities in tables of our tasks, by key."""

FOREIGN_QUANTITIES = (
    RETURN, SUCCESS, Quantity(Column("length", "length", "steps", 1, bounds=AT_LEAST_ZERO))
)  # fmt: skip


def quantities_of(case: Case) -> tuple[Quantity, ...]:
    """Returns the quantities of a case: no score without references, fewer in foreign tasks."""
    if case.world is None:
        measured = [set(r.evaluation.metrics) for runs in case.runs.values() for r in runs]
        known = set.intersection(*measured)
        return tuple(each for each in FOREIGN_QUANTITIES if each.column.key in known)
    return tuple(q for q in QUANTITIES.values() if case.reference is not None or q is not SCORE)


def case_table(case: Case) -> Table:
    """Returns all quantities of one dataset or spec, one row per label, with 95 % intervals."""
    quantities = quantities_of(case)
    rows = [
        Row(label, len(runs), tuple(estimate_with_zeros(q, case, label) for q in quantities))
        for label, runs in case.runs.items()
    ]
    own = tuple(_without_interval(quantity.data(case)) for quantity in quantities)
    if case.data is not None:
        rows.insert(0, Row(f"data of {case.dataset}", 0, own))
    return Table(tuple(q.column for q in quantities), tuple(rows), _caption_of_case(case))


def budget_table(case: Case, budgets: Mapping[str, float]) -> Table:
    """Returns by how much each label exceeds budgets of costs, and in how many of the episodes.

    A label keeps a budget, the largest mean cost of an episode by the name of the cost
    (`event_costs.COSTS`), if the whole interval of the first is at most 0.
    """
    columns, rows = [], []
    for name, budget in budgets.items():
        shown = QUANTITIES[name].column.label
        over = Column(f"{name}_over_budget", f"{shown} - {budget:g}", "", 3)
        share = Column(
            f"{name}_over_budget_share", f"episodes above {budget:g}", "%", 1, 100.0, is_rate=True
        )
        columns += [over, share]
    for label, runs in case.runs.items():
        costs = [(case.metric(label, name), budget) for name, budget in budgets.items()]
        pairs = (
            (_over_budget(c, b), rare_rate_interval((c > b).astype(np.float64))) for c, b in costs
        )
        rows.append(Row(label, len(runs), tuple(chain.from_iterable(pairs))))
    return Table(tuple(columns), tuple(rows), _caption_of_case(case))


def _over_budget(costs: Double, budget: float) -> Estimate:
    """How far the mean cost of an episode is above a budget."""
    return Estimate(*(end - budget for end in count_interval(costs)))


def estimate_with_zeros(quantity: Quantity, case: Case, label: str) -> Estimate:
    """As `estimate`, but counts without an event and rare outcomes have wider intervals.

    Studies estimate without them, as their tables were published.
    """
    values = quantity.values(case, label)
    if quantity.column.key in COSTS:
        return count_interval(values)
    if quantity.column.is_rate and not np.isnan(values).any():
        return rare_rate_interval(values)
    return estimate(quantity, case, label)


def estimate(quantity: Quantity, case: Case, label: str) -> Estimate:
    """Estimates a quantity of a label; undefined if it is undefined in any episode."""
    low, high = quantity.column.bounds
    column = replace(quantity.column, bounds=(low, min(high, quantity.limit(case))))
    return estimate_values(quantity.values(case, label), column)


def estimate_values(values: Double, column: Column) -> Estimate:
    """Estimates the mean of values [runs, episodes] of a column; undefined if one of them is."""
    if np.isnan(values).any():
        return UNDEFINED_ESTIMATE
    return rate_interval(values) if column.is_rate else mean_interval(values, bounds=column.bounds)


def _without_interval(value: float | None) -> Estimate:
    return UNDEFINED_ESTIMATE if value is None else Estimate(value, math.nan, math.nan)


def _caption_of_case(case: Case) -> str:
    what = f"Mean [95 % interval for {target_of([len(runs) for runs in case.runs.values()])}]"
    spec, runs = case.spec, next(iter(case.runs.values()))
    seeds = runs[0].evaluation.seeds
    where = f"{what}; {len(seeds)} episodes of {spec.task}"
    if case.world is None:
        return f"{where} of {spec.library or 'another library'}, spec {spec.hash()[:12]}."
    block = "validation" if seeds[0] >= VALIDATION_BASE else "evaluation"
    return (
        f"{where} on the {block} seeds, {describe(case.world)}, spec {spec.hash()[:12]}. "
        "Collisions are new contacts per episode. Time to goal counts an unsolved episode as "
        f"{case.time_limit:g} s."
    )


def score_table(results: ResultSet) -> Table:
    """Returns the score of every label on every dataset that has one, below that of the data."""
    cases = [case for case in results.cases if SCORE in quantities_of(case)]
    columns = tuple(replace(SCORE.column, key=case.name, label=case.name) for case in cases)
    rows = [
        Row(
            label,
            max(len(case.runs.get(label, ())) for case in results.cases),
            tuple(
                estimate(SCORE, case, label) if label in case.runs else UNDEFINED_ESTIMATE
                for case in cases
            ),
        )
        for label in results.labels
    ]
    own = tuple(_without_interval(case.data_score) for case in cases)
    if not all(math.isnan(each.value) for each in own):
        rows.insert(0, Row("data", 0, own))
    return Table(columns, tuple(rows), _caption_of_scores(cases))


def _caption_of_scores(cases: Sequence[Case]) -> str:
    views = "".join(f" {case.name}: {words}." for case in cases for words in _words_of_view(case))
    target = target_of([len(runs) for case in cases for runs in case.runs.values()])
    return (
        f"Score: mean [95 % interval for {target}]. 0 is the better of an idle and a random team, "
        "100 the expert. Row data: the mean of the dataset's own episodes, with action noise."
        f"{views}"
    )


def _words_of_view(case: Case) -> Iterator[str]:
    """What was changed in the dataset that policies learned from, or some of them."""
    if "observation" in case.view and case.spec.world is not None:
        yield f"re-observed with {describe(case.spec.world)}"
    for label, rewards in case.rewards.items():
        yield f"{label} learned from rewards with {words_of_rewards(rewards)}"


def aggregate_table(results: ResultSet) -> Table:
    """Returns the mean and the optimality gap of scores over all datasets."""
    found = comparable_scores(results)
    columns = Column("mean", "mean", "", 1), Column("optimality_gap", "optimality gap", "", 1)
    rows = []
    for label, table in found.tables.items():
        gap = optimality_gap(table.mean(axis=-1))
        rows.append(Row(label, len(table), (mean_over_datasets(table), _without_interval(gap))))
    own = [results.case(dataset).data_score for dataset in found.datasets]
    known = [score for score in own if score is not None]
    if known and len(known) == len(own):
        values = float(np.mean(known)), optimality_gap(np.array([known]))
        rows.insert(0, Row("data", 0, tuple(map(_without_interval, values))))
    caption = (
        f"Scores {_over(found)} [95 % interval for {_target(found)}, on these datasets]. The "
        "optimality gap is how far the measured runs stay below 100, on average."
    )
    return Table(columns, tuple(rows), caption)


def difference_table(results: ResultSet) -> Table:
    """Returns the mean score of the row minus that of the column, paired by episode."""
    found = comparable_scores(results)
    pairs = differences(found.tables)
    columns = tuple(Column(label, label, "", 1) for label in found.tables)
    rows = tuple(
        Row(
            label, len(table), tuple(pairs.get((label, c.key), UNDEFINED_ESTIMATE) for c in columns)
        )
        for label, table in found.tables.items()
    )
    caption = (
        "Mean score of the row minus that of the column, paired by episode, "
        f"{_over(found)} [95 % interval for {_target(found)}, on these datasets]."
    )
    return Table(columns, rows, caption)


def _target(found: ComparableScores) -> str:
    return target_of([len(table) for table in found.tables.values()])


def _over(found: ComparableScores) -> str:
    """The datasets of an aggregate, and what is left out."""
    names_of: dict[str, list[str]] = {}
    for name, why in found.left_out.items():
        names_of.setdefault(why, []).append(name)
    left = "".join(f"; {', '.join(names)} left out, {why}" for why, names in names_of.items())
    n_datasets = len(found.datasets)
    several = "one dataset" if n_datasets == 1 else f"{n_datasets} datasets"
    return f"over runs and {several} ({', '.join(found.datasets)}{left})"
