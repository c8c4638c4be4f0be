"""What doubling the updates does to the order of the families, paired by episode."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

from swarmdata.drawing.markdown import table
from swarmdata.evaluation.results.estimate_table import UNDEFINED
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import Verdict, main_column, verdict_of
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.plan import DifferencesPlan


class Doubled(NamedTuple):
    """Two families on a dataset: which is better after some updates, and after twice as many."""

    one: str
    other: str
    dataset: str  # short name
    updates: int
    before: Verdict  # of the score of `one` minus that of `other`
    after: Verdict

    @property
    def is_turned_round(self) -> bool:
        """Whether one is clearly better before and the other after."""
        return {self.before, self.after} == {"higher", "lower"}


class _Board(NamedTuple):
    """Scores of a study by short name of the dataset, and its doublings by updates."""

    scores: Scoreboard
    ids: dict[str, str]  # short name of a dataset -> dataset
    rows: dict[int, dict[str, tuple[str, str]]]  # updates -> family -> label, and that of twice


def doubled_orders(found: Findings, plan: DifferencesPlan) -> list[Doubled]:
    """The pairs of families whose rows were measured with some updates and with twice as many."""
    board = _board_of(found, plan)
    return [
        Doubled(
            one,
            other,
            dataset,
            updates,
            verdict_of(board.scores.lead(board.ids[dataset], rows[one][0], rows[other][0])),
            verdict_of(board.scores.lead(board.ids[dataset], rows[one][1], rows[other][1])),
        )
        for updates, rows in sorted(board.rows.items())
        for dataset in board.ids
        for one, other in combinations(_measured(board, dataset, rows), 2)
    ]


def orders_kept(doubled: Sequence[Doubled]) -> str:
    """How many orders of two families stay and how many turn round, by what is doubled."""
    parts = []
    for updates in sorted({each.updates for each in doubled}):
        here = [each for each in doubled if each.updates == updates]
        same = sum(each.before == each.after for each in here)
        turned = sum(each.is_turned_round for each in here)
        parts.append(
            f"{updates:,} updates leaves {same} of {len(here)} as they are and turns {turned} round"
        )
    return f"Of the orders of two families, doubling {'; doubling '.join(parts)}."


def order_sentences(doubled: Sequence[Doubled]) -> list[str]:
    """For each number of updates, how many orders of two families doubling it changes."""
    return [
        _sentence(updates, [each for each in doubled if each.updates == updates])
        for updates in sorted({each.updates for each in doubled})
    ]


def _sentence(updates: int, doubled: Sequence[Doubled]) -> str:
    turned = [each for each in doubled if each.is_turned_round]
    same = [each for each in doubled if each.before == each.after]
    clear = [each for each in doubled if each.before == "no clear change" != each.after]
    unclear = [each for each in doubled if each.before != "no clear change" == each.after]
    parts = [
        f"leaves {len(same)} as they are",
        f"turns {_counted(turned)} round",
        f"makes {_counted(clear)} clear that were not",
        f"and leaves {_counted(unclear)} no longer clear",
    ]
    n_datasets = len({each.dataset for each in doubled})
    where = "one dataset" if n_datasets == 1 else f"{n_datasets} datasets"
    return (
        f"Orders of two families on {where}: of {len(doubled)}, doubling {updates:,} updates "
        f"{', '.join(parts)}."
    )


def _counted(orders: Sequence[Doubled]) -> str:
    if not orders:
        return "0"
    named = "; ".join(f"{each.one} and {each.other} on {each.dataset}" for each in orders)
    return f"{len(orders)} ({named})"


def order_table(found: Findings, plan: DifferencesPlan) -> str:
    """The families with their scores, the best first, by dataset and number of updates.

    `>` where a family is clearly better than the next one, `≥` where it is not.
    """
    board = _board_of(found, plan)
    labels = dict(_labels_by_updates(board))
    lengths = sorted(labels)
    rows = [
        (dataset, *(_order(board, dataset, labels[updates]) for updates in lengths))
        for dataset in board.ids
    ]
    return table(("dataset", *(f"{updates:,} updates" for updates in lengths)), rows)


def _labels_by_updates(board: _Board) -> Iterator[tuple[int, dict[str, str]]]:
    for updates in {length for each in board.rows for length in (each, 2 * each)}:
        shorter = {family: pair[0] for family, pair in board.rows.get(updates, {}).items()}
        longer = {family: pair[1] for family, pair in board.rows.get(updates // 2, {}).items()}
        yield updates, longer | shorter


def _order(board: _Board, dataset: str, labels: dict[str, str]) -> str:
    column, source = board.scores.column, board.ids[dataset]
    estimates = board.scores.estimates[source]
    measured = [family for family in labels if labels[family] in estimates]
    ranked = sorted(measured, key=lambda family: -estimates[labels[family]].value)
    text = ""
    for k, family in enumerate(ranked):
        if k > 0:
            lead = board.scores.lead(source, labels[ranked[k - 1]], labels[family])
            text += " > " if lead.low > 0.0 else " ≥ "
        value = column.factor * estimates[labels[family]].value
        text += f"{family} {value:.{column.decimals}f}"
    return text or UNDEFINED


def _board_of(found: Findings, plan: DifferencesPlan) -> _Board:
    study = found.study
    scores = make_scoreboard(found.results, found.families, main_column(found).key)
    shown = {short_name(dataset) for dataset in study.datasets}
    offline = [cell for cell in found.cells if cell.kind == "offline" and cell.data in shown]
    known = {cell.data: found.facts[cell.name].id for cell in offline}
    ids = {name: known[name] for name in map(short_name, study.datasets) if name in known}
    rows: dict[int, dict[str, tuple[str, str]]] = {}
    for longer, shorter in plan.pairs:
        variant = study.algorithms[shorter]
        assert variant.updates is not None  # checked by Study
        rows.setdefault(variant.updates, {})[variant.family] = (shorter, longer)
    return _Board(scores, ids, rows)


def _measured(board: _Board, dataset: str, rows: dict[str, tuple[str, str]]) -> list[str]:
    done = board.scores.values[board.ids[dataset]]
    return [family for family, labels in rows.items() if set(labels) <= done.keys()]
