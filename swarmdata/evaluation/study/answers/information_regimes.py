"""Information: what it costs to train and act with worse sensors and radios."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import Column, format_estimate
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.answer_figures import plot_differences_from_zero
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.information_section import view_columns
from swarmdata.evaluation.study.pages.row_differences import format_difference, verdict_of
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard, quantity_of
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate


class ViewChange(NamedTuple):
    """What a view changes for an algorithm that is trained and evaluated with it."""

    dataset: str
    label: str
    view: str
    reference: str  # the first view of the plan that was measured
    value: Estimate  # with the view
    change: Estimate  # view minus reference, paired by episode
    column: Column


def answer_information_regimes(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies that train and evaluate in several views of the same data."""
    changes = {each.name: list(_changes(each)) for each in evidence}
    chosen = [each for each in evidence if changes[each.name]]
    if not chosen:
        return None
    shown = [change for each in chosen for change in changes[each.name]]
    figure = "information.png"
    rows = [f"{c.label}, {c.view} − {c.reference}, {c.dataset}" for c in shown]
    plot_differences_from_zero(
        rows, {f"change of {shown[0].column.label}": [c.change for c in shown]}, out / figure
    )
    details = f"![what each view changes]({figure})\n\n" + "\n".join(
        f"Study {each.name}:\n\n{_table(changes[each.name])}" for each in chosen
    )
    return Answer(tuple(map(_sentence, shown)), details, tuple(chosen), (figure,))


def _changes(evidence: Evidence) -> Iterator[ViewChange]:
    found, plan = evidence.found, evidence.found.study.information
    if plan is None or found.views is None:
        return
    families = {label: found.family(label) for label in plan.algorithms}
    board = make_scoreboard(found.views, families, quantity_of(found.views).column.key)
    for dataset in map(short_name, plan.datasets):
        columns = list(view_columns(found, dataset))
        for reference, first in columns[:1]:
            for label, base in board.values[first].items():
                for view, case in columns[1:]:
                    values = board.values[case].get(label)
                    if values is not None:
                        value = board.estimates[case][label]
                        change = difference_interval(values, base)
                        yield ViewChange(
                            dataset, label, view, reference, value, change, board.column
                        )


def _sentence(change: ViewChange) -> str:
    shown = format_difference(change.change, change.column)
    return (
        f"`{change.label}` on {change.dataset}, with `{change.view}` instead of "
        f"`{change.reference}`: {change.column.label} {shown} ({verdict_of(change.change)})."
    )


def _table(changes: Sequence[ViewChange]) -> str:
    rows = [
        (
            f"`{each.label}`",
            each.dataset,
            f"`{each.view}`",
            format_estimate(each.value, each.column),
            f"{format_difference(each.change, each.column)}, {verdict_of(each.change)}",
        )
        for each in changes
    ]
    column = changes[0].column
    head = ("algorithm", "dataset", "view", column.header, f"minus `{changes[0].reference}`")
    return markdown.table(head, rows)
