"""The sections on differences: those that a study asks for, and how far rows are from the data."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED
from swarmdata.evaluation.results.result_tables import UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.difference_figure import plot_row_differences
from swarmdata.evaluation.study.pages.doubling import budget_table, order_table
from swarmdata.evaluation.study.pages.row_differences import (
    columns_of,
    format_difference,
    main_column,
    measured_differences,
    missing_pairs,
    verdict_of,
)
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.plan import DifferencesPlan, Study
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

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


CLONE = "bc"
"""The algorithm that copies the data."""


class Distance(NamedTuple):
    """How far a row is from the data on a dataset."""

    dataset: str
    label: str
    from_mean: Estimate  # of the data: a known number, so nothing is paired
    from_clone: Estimate  # paired by episode


def clone_of(study: Study) -> str:
    """The label of the plain clone; empty if the study has none."""
    plain = (
        label
        for label, row in study.algorithms.items()
        if row.algorithm == CLONE and not row.settings and row.rewards is None
    )
    return next(plain, "")


def distance_table(found: Findings) -> str:
    """A row for each dataset and row of the study."""
    board = make_scoreboard(found.results, found.families, main_column(found).key)
    rows = [
        (
            without_version(each.dataset),
            f"`{each.label}`",
            _cell(each.from_mean, board),
            _cell(each.from_clone, board),
        )
        for each in _distances(board, clone_of(found.study))
    ]
    label = board.column.label
    head = ("dataset", "row", f"{label} minus the mean of the data", f"{label} minus the clone's")
    return markdown.table(head, rows)


def _distances(board: Scoreboard, clone: str) -> Iterator[Distance]:
    for dataset, estimates in board.estimates.items():
        mean = board.data.get(dataset)
        for label, found in estimates.items():
            from_mean = UNDEFINED_ESTIMATE if mean is None else Estimate(*(e - mean for e in found))
            is_paired = clone in estimates and label != clone
            from_clone = board.lead(dataset, label, clone) if is_paired else UNDEFINED_ESTIMATE
            yield Distance(dataset, label, from_mean, from_clone)


def _cell(difference: Estimate, board: Scoreboard) -> str:
    if difference is UNDEFINED_ESTIMATE:
        return UNDEFINED
    return f"{format_difference(difference, board.column)}, {verdict_of(difference)}"
