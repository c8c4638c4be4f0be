"""Differences between rows of a study, paired by episode, and what they say."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from swarmdata.evaluation.results.estimate_table import UNDEFINED, Column, format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES, UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard, quantity_of
from swarmdata.evaluation.study.plan import DifferencesPlan, Study
from swarmdata.rollouts.score_statistics import Estimate

Verdict = Literal["higher", "lower", "no clear change"]


@dataclass(frozen=True)
class RowDifference:
    """One row minus another on a dataset."""

    one: str
    other: str
    dataset: str  # short name
    estimates: Mapping[str, Estimate]  # by the quantity's key, in stored units

    @property
    def words(self) -> str:
        """The difference as text."""
        return f"`{self.one}` − `{self.other}`"


def verdict_of(difference: Estimate) -> Verdict:
    """Whether a difference is above 0 with its whole interval, below, or neither."""
    if difference.low > 0.0:
        return "higher"
    return "lower" if difference.high < 0.0 else "no clear change"


def main_column(found: Findings) -> Column:
    """The column of the score; of the return, if a world of the study has no measured expert."""
    return quantity_of(found.results).column


def columns_of(found: Findings) -> tuple[Column, ...]:
    """What differences are taken of."""
    return (
        main_column(found),
        *(QUANTITIES[key].column for key in ("success", "clean_success")),
    )


def measured_differences(found: Findings, plan: DifferencesPlan) -> list[RowDifference]:
    """The differences of all pairs whose cells are done, by pair, then by dataset."""
    columns = columns_of(found)
    boards = {c.key: make_scoreboard(found.results, found.families, c.key) for c in columns}
    ids = {cell.data: found.facts[cell.name].id for cell in found.cells if cell.kind == "offline"}
    return [
        RowDifference(
            one,
            other,
            dataset,
            {
                key: board.lead(ids[dataset], one, other)
                if {one, other} <= board.values.get(ids[dataset], {}).keys()
                else UNDEFINED_ESTIMATE
                for key, board in boards.items()
            },
        )
        for (one, other), dataset in _wanted(found.study, plan)
        if not _missing_of(found, one, other, dataset)
    ]


def missing_pairs(found: Findings, plan: DifferencesPlan) -> list[str]:
    """The pairs of which a cell is not done, each in a few words."""
    return [
        f"`{one}` − `{other}` on {dataset} (no results of {' and '.join(absent)})"
        for (one, other), dataset in _wanted(found.study, plan)
        if (absent := _missing_of(found, one, other, dataset))
    ]


def _wanted(study: Study, plan: DifferencesPlan) -> Iterator[tuple[tuple[str, str], str]]:
    for one, other in plan.pairs:
        for dataset in study.datasets:
            if study.has(one, dataset) and study.has(other, dataset):
                yield (one, other), short_name(dataset)


def _missing_of(found: Findings, one: str, other: str, dataset: str) -> list[str]:
    done = {cell.name for cell in found.cells}
    return [f"`{label}`" for label in (one, other) if f"{label}/{dataset}" not in done]


def format_difference(difference: Estimate, column: Column) -> str:
    """A difference with its sign and interval, in the column's unit."""
    text = format_estimate(difference, column)
    sign = "+" if difference.value > 0.0 and text[0] not in f"-{UNDEFINED}" else ""
    return f"{sign}{text}".replace("-", "−")


def verdict_summary(differences: Sequence[RowDifference], column: Column) -> str:
    """How many differences of a quantity are clearly above 0, below, or neither."""
    verdicts = [verdict_of(each.estimates[column.key]) for each in differences]
    parts = [
        f"{kind} in {verdicts.count(kind)}"
        for kind in ("higher", "lower", "no clear change")
        if kind in verdicts
    ]
    label = column.label[:1].upper() + column.label[1:]
    return f"{label}, in {len(verdicts)} comparisons: {', '.join(parts)}."


def doubling_sentences(found: Findings, plan: DifferencesPlan) -> list[str]:
    """For each family, the shortest budget after which doubling changes no score clearly.

    A change is clear if its interval excludes 0. All longer doublings that were tried have to pass
    too, on every dataset that the rows are trained on.
    """
    measured = measured_differences(found, plan)
    families: dict[str, list[tuple[str, str]]] = {}
    for one, other in plan.pairs:
        families.setdefault(found.study.algorithms[one].family, []).append((one, other))
    return [_shortest_budget(found, family, pairs, measured) for family, pairs in families.items()]


def _shortest_budget(
    found: Findings,
    family: str,
    pairs: Sequence[tuple[str, str]],
    measured: Sequence[RowDifference],
) -> str:
    name = family[:1].upper() + family[1:]
    datasets = found.study.datasets
    by_budget: dict[int, list[RowDifference]] = {}
    for one, other in pairs:
        budget = found.study.algorithms[other].updates
        assert budget is not None  # checked by Study
        each = [d for d in measured if (d.one, d.other) == (one, other)]
        n_wanted = sum(found.study.has(one, d) & found.study.has(other, d) for d in datasets)
        if len(each) < n_wanted:
            return (
                f"{name}: not known yet, because doubling {budget:,} updates was measured on "
                f"{len(each)} of {n_wanted} datasets."
            )
        by_budget.setdefault(budget, []).extend(each)
    return f"{name}: {enough_updates(by_budget, main_column(found))}"


def enough_updates(by_budget: Mapping[int, list[RowDifference]], column: Column) -> str:
    """The shortest budget from which on no doubling changes a score clearly, in words.

    Args:
        by_budget: updates that are doubled -> the changes on all datasets.
        column: of the quantity.
    """
    passed: list[RowDifference] = []
    shortest, still = None, ""
    for budget in sorted(by_budget, reverse=True):
        changed = [d for d in by_budget[budget] if _is_clear(d, column)]
        if changed:
            words = _words_of_changes(changed, column)
            still = f" Doubling {budget:,} updates changes the {column.label}: {words}."
            break
        passed += by_budget[budget]
        shortest = budget
    if shortest is None:
        return f"no budget that was tried is enough.{still}"
    widest = max(passed, key=lambda d: _largest(d.estimates[column.key]))
    room = column.factor * _largest(widest.estimates[column.key])
    names = {d.dataset for d in passed}
    where = f"on any of {len(names)} datasets" if len(names) > 1 else f"on {widest.dataset}"
    return (
        f"{shortest:,} updates. No doubling that was tried from there on changes the "
        f"{column.label} clearly {where}; the intervals leave room for at most "
        f"{room:.{column.decimals}f} ({widest.words} on {widest.dataset}).{still}"
    )


def _is_clear(difference: RowDifference, column: Column) -> bool:
    return verdict_of(difference.estimates[column.key]) != "no clear change"


def _largest(difference: Estimate) -> float:
    """The largest change that an interval leaves room for."""
    ends = [abs(end) for end in difference if not math.isnan(end)]
    return max(ends, default=math.nan)


def _words_of_changes(changed: Sequence[RowDifference], column: Column) -> str:
    return "; ".join(
        f"{format_difference(each.estimates[column.key], column)} on {each.dataset}"
        for each in changed
    )
