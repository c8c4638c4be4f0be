"""Differences between rows of a study, paired by episode, and the sections on them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.drawing.style import words_of_pair
from swarmdata.evaluation.figures.dot_plot import (
    HOLLOW_LOOK,
    MAX_PANELS_IN_A_LINE,
    Panel,
    PanelLine,
    plot_dots,
)
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import UNDEFINED, Column, format_estimate
from swarmdata.evaluation.results.result_tables import UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.evaluation.study.plan import DifferencesPlan, Study
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

UNCLEAR = "no clear change"


class RowDifference(NamedTuple):
    """One row minus another on a dataset."""

    one: str
    other: str
    dataset: str  # short name
    estimates: Mapping[str, Estimate]  # by the quantity's key, in stored units

    @property
    def pair(self) -> str:
        """The rows in words, for figures."""
        return words_of_pair(self.one, self.other)

    def shown(self, column: Column) -> Estimate:
        """A quantity in the unit of tables and figures."""
        return column.shown(self.estimates[column.key])


def difference_rows(found: Findings) -> list[dict[str, object]]:
    """One row per list of pairs, pair, dataset and quantity: the difference, in stored units."""
    head = ("list", "one", "other", "dataset", "quantity", "mean", "low", "high")
    return [
        dict(zip(head, (name, one, other, dataset, key, *estimate), strict=True))
        for name, plan in found.study.differences.items()
        for one, other, dataset, estimates in measured_differences(found, plan)
        for key, estimate in estimates.items()
    ]


def verdict_of(difference: Estimate) -> str:
    """Whether a difference is above 0 with its whole interval, below, or neither."""
    if difference.low > 0.0:
        return "higher"
    return "lower" if difference.high < 0.0 else UNCLEAR


def measured_differences(found: Findings, plan: DifferencesPlan) -> list[RowDifference]:
    """The differences of all pairs whose cells are done, by pair, then by dataset."""
    boards, ids = [found.board(each.column.key) for each in found.quantities], found.dataset_ids
    differences = []
    for (one, other), dataset, missing in _wanted(found, plan):
        if not missing:
            estimates = {
                board.column.key: board.lead(ids[dataset], one, other)
                if {one, other} <= board.values.get(ids[dataset], {}).keys()
                else UNDEFINED_ESTIMATE
                for board in boards
            }
            differences.append(RowDifference(one, other, dataset, estimates))
    return differences


def _wanted(
    found: Findings, plan: DifferencesPlan
) -> Iterator[tuple[tuple[str, str], str, list[str]]]:
    """Each pair on each of its datasets, and the rows of it that are not done there."""
    study, done = found.study, {cell.name for cell in found.cells}
    for pair in plan.pairs:
        for dataset in study.datasets:
            if all(study.has(label, dataset) for label in pair):
                name = short_name(dataset)
                yield pair, name, [f"`{k}`" for k in pair if f"{k}/{name}" not in done]


def format_difference(difference: Estimate, column: Column) -> str:
    """A difference with its sign and interval, in the column's unit."""
    text = format_estimate(difference, column)
    sign = "+" if difference.value > 0.0 and text[0] not in f"-{UNDEFINED}" else ""
    return f"{sign}{text}".replace("-", "−")


PAIRED = (
    "The first row minus the second, paired by episode. A difference is higher or lower if its "
    "whole interval is.\n"
)
ORDERS = (
    "Families by score, the best first. `>`: clearly better than the next, paired by episode; `≥`: "
    "not clearly.\n"
)


def differences_sections(found: Findings, out: Path) -> list[tuple[str, str]]:
    """Title and body of each list of pairs, with a figure in a folder.

    A table has a row for each pair and dataset. Then comes what doublings change, and what is not
    measured.
    """
    sections, columns = [], [each.column for each in found.quantities]
    head = ("difference", "dataset", *(each.header for each in columns))
    for name, plan in found.study.differences.items():
        measured, parts = measured_differences(found, plan), [PAIRED]
        if measured:
            plot_row_differences(measured, columns, out / f"differences-{name}.png")
            rows = [
                (f"`{one}` − `{other}`", dataset, *(_with_verdict(of[k.key], k) for k in columns))
                for one, other, dataset, of in measured
            ]
            picture = f"![the first row minus the second](differences-{name}.png)\n"
            parts += [picture, markdown.table(head, rows)]
        if plan.doubling and measured:
            orders = order_table(found, plan)
            parts += [ORDERS, orders, budget_table(found, plan.pairs, measured)]
        missing = [
            f"- `{one}` − `{other}` on {dataset} (no results of {' and '.join(labels)})\n"
            for (one, other), dataset, labels in _wanted(found, plan)
            if labels
        ]
        parts += ["Not compared yet:\n", "".join(missing)] if missing else []
        sections.append((plan.title, "\n".join(parts)))
    return sections


CLONE = "bc"  # the algorithm that copies the data


def distance_table(found: Findings) -> str:
    """How far each row of the study is from the mean of each dataset, and from its plain clone.

    The mean of the data is a known number, so nothing is paired with it.
    """
    plain = (
        label
        for label, row in found.study.algorithms.items()
        if row.algorithm == CLONE and not row.settings and row.rewards is None
    )
    board, clone, rows = found.main, next(plain, ""), []
    for dataset, estimates in board.estimates.items():
        mean = board.data.get(dataset)
        for label, own in estimates.items():
            cells = [UNDEFINED, UNDEFINED]
            if mean is not None:
                cells[0] = _with_verdict(Estimate(*(end - mean for end in own)), board.column)
            if clone in estimates and label != clone:
                cells[1] = _with_verdict(board.lead(dataset, label, clone), board.column)
            rows.append((without_version(dataset), f"`{label}`", *cells))
    label = board.column.label
    head = ("dataset", "row", f"{label} minus the mean of the data", f"{label} minus the clone's")
    return markdown.table(head, rows)


def _with_verdict(difference: Estimate, column: Column) -> str:
    return f"{format_difference(difference, column)}, {verdict_of(difference)}"


CHANGE_LIMIT = 60.0  # points of score at which colors end


def plot_row_differences(
    differences: Sequence[RowDifference], columns: Sequence[Column], path: Path
) -> None:
    """Draws differences beside 0, of the quantities in columns, the main one first.

    Of one pair, or on one dataset, every quantity is a panel. Several pairs on a few datasets have
    a panel for each dataset, with the first quantity; on many datasets they are a matrix.
    """
    main, pairs = columns[0], list(dict.fromkeys(each.pair for each in differences))
    datasets = list(dict.fromkeys(each.dataset for each in differences))
    if len(datasets) == 1 or len(pairs) == 1:
        by_pair = len(datasets) == 1
        found = [
            {each.pair if by_pair else each.dataset: each.shown(column) for each in differences}
            for column in columns
        ]
        titles = [datasets[0] if by_pair else pairs[0], *[""] * (len(columns) - 1)]
        _plot_changes(found, titles, [f"change of {column.header}" for column in columns], path)
    elif len(datasets) <= MAX_PANELS_IN_A_LINE:
        found = [
            {each.pair: each.shown(main) for each in differences if each.dataset == name}
            for name in datasets
        ]
        _plot_changes(found, datasets, [f"change of {main.header}"] * len(datasets), path)
    else:
        cells = {
            (each.dataset, each.pair): MatrixCell(value, value, verdict_of(change) != UNCLEAR)
            for each in differences
            if not math.isnan(value := (change := each.shown(main)).value)
        }
        rows: dict[str, list[str]] = {}
        for name in sorted(datasets):
            rows.setdefault(name.partition("-")[0], []).append(name)
        notes = Notes(
            CHANGE_LIMIT, f"change of {main.label}, paired by episode",
            "framed: clearly not 0; dot: not run",
        )  # fmt: skip
        values = {pair: [cell.value for (_, each), cell in cells.items() if each == pair]
                  for pair in pairs}  # fmt: skip
        order = sorted(pairs, key=lambda pair: (-len(values[pair]), -sum(values[pair])))
        plot_matrix(cells, rows, {"": order}, path, notes)


def _plot_changes(
    found: Sequence[Mapping[str, Estimate]],
    titles: Sequence[str],
    labels: Sequence[str],
    path: Path,
) -> None:
    rows = list(dict.fromkeys(row for each in found for row in each))
    rows.sort(key=lambda row: -found[0][row].value if row in found[0] else math.inf)
    panels = []
    for each, title, label in zip(found, titles, labels, strict=True):
        known = {row: change for row, change in each.items() if not math.isnan(change.value)}
        unclear = [row for row, change in known.items() if verdict_of(change) == UNCLEAR]
        panels.append(Panel(known, label, title, scale=label, hollow=unclear))
    plot_dots([PanelLine(rows, panels)], {}, path, legend={UNCLEAR: HOLLOW_LOOK}, zero=True)


Budgets = dict[int, list[RowDifference]]  # updates that are doubled -> the changes on all datasets


def budget_table(
    found: Findings, pairs: Sequence[tuple[str, str]], measured: Sequence[RowDifference]
) -> str:
    """For each family, the shortest budget after which doubling changes no score clearly.

    All longer doublings that were tried have to pass too, on every dataset of the rows. Beside it
    are the clear changes of the longest doubling that does not pass.
    """
    study, rows = found.study, []
    families: dict[str, list[tuple[str, str]]] = {}
    for one, other in pairs:
        families.setdefault(study.algorithms[one].family, []).append((one, other))
    for family, own in families.items():
        budgets = _budgets(study, own, measured)
        unknown = UNDEFINED, "not measured on all datasets"
        rows.append((family, *(_enough(budgets, found.main.column) if budgets else unknown)))
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
            if verdict_of(change) != UNCLEAR
        ]
        if clear:
            return enough, f"{budget:,} updates: {'; '.join(clear)}"
        enough = f"{budget:,}"
    return enough, ""


def order_table(found: Findings, plan: DifferencesPlan) -> str:
    """The families with their scores, the best first, by dataset and number of updates.

    `>` where a family is clearly better than the next one, `≥` where it is not.
    """
    study, ids = found.study, found.dataset_ids
    # updates -> family -> row; the shorter one of a pair wins
    labels: dict[int, dict[str, str]] = {}
    for place in (0, 1):
        for pair in plan.pairs:
            family = study.algorithms[pair[place]].family
            labels.setdefault(_updates(study, pair[place]), {})[family] = pair[place]
    rows = [
        (name, *(_order(found.main, ids[name], labels[n]) for n in sorted(labels)))
        for name in map(short_name, study.datasets)
        if name in ids
    ]
    return markdown.table(("dataset", *(f"{n:,} updates" for n in sorted(labels))), rows)


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
