"""The sections on differences that a study asks for: its pairs of rows, paired by episode."""

from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.difference_figure import plot_row_differences
from swarmdata.evaluation.study.pages.doubling import budget_table, order_table
from swarmdata.evaluation.study.pages.row_differences import (
    columns_of,
    format_difference,
    measured_differences,
    missing_pairs,
    verdict_of,
)
from swarmdata.evaluation.study.plan import DifferencesPlan

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
    if differences := measured_differences(found, plan):
        plot_row_differences(differences, columns_of(found), out / figure)
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
