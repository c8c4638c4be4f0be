"""The sections on differences that a study asks for: its pairs of rows, paired by episode."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    columns_of,
    doubling_sentences,
    format_difference,
    measured_differences,
    missing_pairs,
    verdict_of,
    verdict_summary,
)

MAX_NAMED_PAIRS = 4
"""Pairs without results that a sentence names."""


def differences_sections(found: Findings, out: Path) -> dict[str, str]:
    """One section for each list of pairs, by its title.

    Args:
        found: what was measured.
        out: folder of the page; these sections have no figures.
    """
    return {plan.title: _section(found, name) for name, plan in found.study.differences.items()}


def _section(found: Findings, name: str) -> str:
    plan = found.study.differences[name]
    differences, columns = measured_differences(found, plan), columns_of(found)
    is_list = len(differences) > 1
    sentences = [verdict_summary(differences, column) for column in columns if is_list]
    sentences += doubling_sentences(found, plan) if plan.doubling else []
    if missing := missing_pairs(found, plan):
        sentences.append(not_compared(missing))
    head = (
        "The first row minus the second, paired by episode. A difference is higher or lower if "
        "its whole interval is.\n\n"
    )
    table = difference_table(differences, columns) + "\n" if differences else ""
    return head + table + "".join(f"- {sentence}\n" for sentence in sentences)


def not_compared(missing: Sequence[str]) -> str:
    """The sentence that names the first pairs that are not measured, and counts the others."""
    others = len(missing) - MAX_NAMED_PAIRS
    tail = f"; and {others} more" if others > 0 else ""
    return f"Not compared yet: {'; '.join(missing[:MAX_NAMED_PAIRS])}{tail}."


def difference_table(differences: Sequence[RowDifference], columns: Sequence[Column]) -> str:
    """A row for each pair and dataset, a column for each quantity."""
    rows = [
        (
            each.words,
            each.dataset,
            *(
                f"{format_difference(each.estimates[column.key], column)}, "
                f"{verdict_of(each.estimates[column.key])}"
                for column in columns
            ),
        )
        for each in differences
    ]
    return markdown.table(("difference", "dataset", *(each.header for each in columns)), rows)
