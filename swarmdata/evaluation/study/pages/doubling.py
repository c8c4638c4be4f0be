"""What doubling the updates changes: which budget is enough, and the order of the families."""

from collections.abc import Mapping, Sequence

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED, Column
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    format_difference,
    main_column,
    measured_differences,
    verdict_of,
)
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.plan import DifferencesPlan, Study

Budgets = dict[int, list[RowDifference]]
"""Updates that are doubled -> the changes on all datasets."""


def budget_table(found: Findings, plan: DifferencesPlan) -> str:
    """For each family, the shortest budget after which doubling changes no score clearly.

    All longer doublings that were tried have to pass too, on every dataset of the rows. Beside it
    are the clear changes of the longest doubling that does not pass.
    """
    measured = measured_differences(found, plan)
    families: dict[str, list[tuple[str, str]]] = {}
    for one, other in plan.pairs:
        families.setdefault(found.study.algorithms[one].family, []).append((one, other))
    rows = []
    for family, pairs in families.items():
        budgets = _budgets(found.study, pairs, measured)
        if budgets is None:
            rows.append((family, UNDEFINED, "not measured on all datasets"))
        else:
            rows.append((family, *_enough(budgets, main_column(found))))
    return markdown.table(("family", "enough updates", "clear changes of the next doubling"), rows)


def _budgets(
    study: Study, pairs: Sequence[tuple[str, str]], measured: Sequence[RowDifference]
) -> Budgets | None:
    """The changes by budget; None if a dataset of a pair was not measured."""
    found: Budgets = {}
    for one, other in pairs:
        each = [d for d in measured if (d.one, d.other) == (one, other)]
        if len(each) < sum(study.has(one, d) and study.has(other, d) for d in study.datasets):
            return None
        found.setdefault(_updates(study, other), []).extend(each)
    return found


def _updates(study: Study, label: str) -> int:
    updates = study.algorithms[label].updates
    assert updates is not None  # checked by Study
    return updates


def _enough(budgets: Budgets, column: Column) -> tuple[str, str]:
    """The shortest budget that is enough, and the changes that make shorter ones too short."""
    enough = UNDEFINED
    for budget in sorted(budgets, reverse=True):
        changes = ((d.dataset, d.estimates[column.key]) for d in budgets[budget])
        clear = [
            f"{format_difference(change, column)} on {dataset}"
            for dataset, change in changes
            if verdict_of(change) != "no clear change"
        ]
        if clear:
            return enough, f"{budget:,} updates: {'; '.join(clear)}"
        enough = f"{budget:,}"
    return enough, ""


def order_table(found: Findings, plan: DifferencesPlan) -> str:
    """The families with their scores, the best first, by dataset and number of updates.

    `>` where a family is clearly better than the next one, `≥` where it is not.
    """
    study = found.study
    board = make_scoreboard(found.results, found.families, main_column(found).key)
    ids = {cell.data: found.facts[cell.name].id for cell in found.cells if cell.kind == "offline"}
    labels = _labels_by_updates(study, plan)
    rows = [
        (name, *(_order(board, ids[name], each) for each in labels.values()))
        for name in map(short_name, study.datasets)
        if name in ids
    ]
    return markdown.table(("dataset", *(f"{updates:,} updates" for updates in labels)), rows)


def _labels_by_updates(study: Study, plan: DifferencesPlan) -> dict[int, dict[str, str]]:
    """Updates -> family -> the row that was trained so long."""
    once: dict[int, dict[str, str]] = {}
    twice: dict[int, dict[str, str]] = {}
    for longer, shorter in plan.pairs:
        updates, family = _updates(study, shorter), study.algorithms[shorter].family
        once.setdefault(updates, {})[family] = shorter
        twice.setdefault(2 * updates, {})[family] = longer
    lengths = sorted({*once, *twice})
    return {updates: twice.get(updates, {}) | once.get(updates, {}) for updates in lengths}


def _order(board: Scoreboard, dataset: str, labels: Mapping[str, str]) -> str:
    column, estimates = board.column, board.estimates[dataset]
    measured = [family for family in labels if labels[family] in estimates]
    ranked = sorted(measured, key=lambda family: -estimates[labels[family]].value)
    text = ""
    for k, family in enumerate(ranked):
        if k > 0:
            lead = board.lead(dataset, labels[ranked[k - 1]], labels[family])
            text += " > " if lead.low > 0.0 else " ≥ "
        text += f"{family} {column.factor * estimates[labels[family]].value:.{column.decimals}f}"
    return text or UNDEFINED
