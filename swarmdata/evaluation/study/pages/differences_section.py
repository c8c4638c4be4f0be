"""The sections on differences that a study asks for: its pairs of rows, paired by episode."""

from collections import Counter
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.doubling import budget_table, order_table
from swarmdata.evaluation.study.pages.row_differences import (
    columns_of,
    format_difference,
    measured_differences,
    missing_pairs,
    verdict_of,
)
from swarmdata.evaluation.study.pages.study_figures import plot_differences_from_zero
from swarmdata.evaluation.study.plan import DifferencesPlan
from swarmdata.rollouts.score_statistics import Estimate

ORDERS = (
    "Families by score, the best first. `>`: clearly better than the next, paired by episode; `≥`: "
    "not clearly.\n\n"
)


def differences_sections(found: Findings, out: Path) -> list[tuple[str, str]]:
    """Title and body of each list of pairs, with a figure in a folder."""
    plans = found.study.differences
    return [(plan.title, _section(found, name, out)) for name, plan in plans.items()]


def _section(found: Findings, name: str, out: Path) -> str:
    plan, figure = found.study.differences[name], f"differences-{name}.png"
    head = (
        "The first row minus the second, paired by episode. A difference is higher or lower if "
        "its whole interval is.\n\n"
    )
    if measured_differences(found, plan):
        _plot_pairs(found, plan, out / figure)
        head += f"![the first row minus the second]({figure})\n\n"
    return head + _tables(found, plan)


def _tables(found: Findings, plan: DifferencesPlan) -> str:
    """A row for each pair and dataset; of doublings what they change; what is not measured."""
    columns = columns_of(found)
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
        for each in measured_differences(found, plan)
    ]
    head = ("difference", "dataset", *(each.header for each in columns))
    parts = [markdown.table(head, rows)] if rows else []
    if plan.doubling and rows:
        parts += [f"{ORDERS}{order_table(found, plan)}", budget_table(found, plan)]
    if missing := missing_pairs(found, plan):
        parts.append("Not compared yet:\n\n" + "".join(f"- {each}\n" for each in missing))
    return "\n".join(parts)


def _plot_pairs(found: Findings, plan: DifferencesPlan, path: Path) -> None:
    """Draws all differences, a row each.

    A group has the pairs on one dataset; a pair on several datasets is a group of its own.
    """
    groups: dict[str, dict[str, list[Estimate]]] = {}
    columns, differences = columns_of(found), measured_differences(found, plan)
    counts = Counter(difference.words for difference in differences)
    for each in differences:
        pair = f"{each.one} − {each.other}"
        is_alone = counts[each.words] == 1
        title, row = (each.dataset, pair) if is_alone else (pair, each.dataset)
        groups.setdefault(title, {})[row] = [
            Estimate(*(column.factor * end for end in each.estimates[column.key]))
            for column in columns
        ]
    plot_differences_from_zero(groups, [f"change of {each.header}" for each in columns], path)
