"""How far from the data: what rows add to the data's mean and to a clone of the data."""

from collections.abc import Iterator
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED
from swarmdata.evaluation.results.result_tables import UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import (
    format_difference,
    main_column,
    verdict_of,
)
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.plan import Study
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

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
