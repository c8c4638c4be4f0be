"""Differences between rows of a study, paired by episode."""

from collections.abc import Iterator, Mapping
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


def difference_rows(found: Findings) -> list[dict[str, object]]:
    """One row per list of pairs, pair, dataset and quantity: the difference, in stored units."""
    return [
        {
            "list": name,
            "one": each.one,
            "other": each.other,
            "dataset": each.dataset,
            "quantity": key,
            "mean": estimate.value,
            "low": estimate.low,
            "high": estimate.high,
        }
        for name, plan in found.study.differences.items()
        for each in measured_differences(found, plan)
        for key, estimate in each.estimates.items()
    ]


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
