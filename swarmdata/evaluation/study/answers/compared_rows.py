"""Answers from differences that studies name alike: sentences, tables, and one figure for all."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.answers.answer_figures import plot_differences_from_zero
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages.differences_section import difference_table, not_compared
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    columns_of,
    format_difference,
    measured_differences,
    missing_pairs,
    verdict_of,
)
from swarmdata.rollouts.score_statistics import Estimate

UNITS = {"": "", "%": " percentage points"}
"""Of differences in sentences, by the unit of the quantity."""


class Compared(NamedTuple):
    """The measured pairs of one study."""

    evidence: Evidence
    differences: list[RowDifference]
    columns: tuple[Column, ...]
    missing: list[str]


def compared_rows(evidence: Sequence[Evidence], name: str) -> list[Compared]:
    """The pairs that studies list under a name, of studies that have measured one."""
    found = []
    for each in evidence:
        plan = each.found.study.differences.get(name)
        differences = measured_differences(each.found, plan) if plan else []
        if plan and differences:
            missing = missing_pairs(each.found, plan)
            found.append(Compared(each, differences, columns_of(each.found), missing))
    return found


def sentence_of(difference: RowDifference, columns: Sequence[Column]) -> str:
    """All quantities of a difference, with verdicts."""
    return ", ".join(
        f"{column.label} {format_difference(found, column)}"
        f"{UNITS[column.unit]} ({verdict_of(found)})"
        for column in columns
        for found in (difference.estimates[column.key],)
    )


def counted_verdicts(compared: Sequence[Compared], what: str) -> str:
    """In how many comparisons the main quantity is higher, lower, or neither."""
    counts = Counter(
        verdict_of(difference.estimates[each.columns[0].key])
        for each in compared
        for difference in each.differences
    )
    n = counts.total()
    return (
        f"In {n} comparison{'s' if n > 1 else ''}, {what} clearly raises the "
        f"{compared[0].columns[0].label} in {counts['higher']}, lowers it in {counts['lower']}, "
        f"and changes nothing clearly in {counts['no clear change']}."
    )


def tables_of(compared: Sequence[Compared]) -> str:
    """A table for each study, and what is missing."""
    parts = []
    for each in compared:
        missing = f"\n{not_compared(each.missing)}\n" if each.missing else ""
        table = difference_table(each.differences, each.columns)
        parts.append(f"Study {each.evidence.name}:\n\n{table}{missing}")
    return "\n".join(parts)


def plot_compared(compared: Sequence[Compared], path: Path) -> None:
    """Draws all differences, a row each.

    A group has the pairs on one dataset; a pair on several datasets is a group of its own.
    """
    groups: dict[str, dict[str, list[Estimate]]] = {}
    for each in compared:
        where = f" (study {each.evidence.name})" if len(compared) > 1 else ""
        counts = Counter(difference.words for difference in each.differences)
        for difference in each.differences:
            pair, dataset = f"{difference.one} − {difference.other}", difference.dataset
            title, row = (pair, dataset) if counts[difference.words] > 1 else (dataset, pair)
            groups.setdefault(f"{title}{where}", {})[row] = [
                Estimate(*(column.factor * end for end in difference.estimates[column.key]))
                for column in each.columns
            ]
    labels = [f"change of {column.header}" for column in compared[0].columns]
    plot_differences_from_zero(groups, labels, path)
