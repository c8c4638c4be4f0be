"""What the numbers of a study say, in sentences that are computed from them."""

from collections.abc import Iterator, Mapping
from itertools import groupby

import numpy as np

from swarmdata.evaluation.results.estimate_table import format_number
from swarmdata.evaluation.study.pages.scoreboard import Board, short
from swarmdata.evaluation.study.pages.study_tables import written

FEW_RANKS = 4
"""A shift by less than a quarter of the ranks between two datasets is no surprise."""


def winners(board: Board) -> list[str]:
    """Which algorithm and which family wins on each dataset, and by how much."""
    return [_winner(board, dataset) for dataset in board.estimates if board.estimates[dataset]]


def _winner(board: Board, dataset: str) -> str:
    found, families = board.estimates[dataset], board.bests(dataset)
    family, *others = families
    best = families[family]
    parts = [f"On {short(dataset)}, `{best}` ({family}) is best with {written(found[best], board)}"]
    if others:
        second = families[others[0]]
        gap = found[best].value - found[second].value
        is_apart = found[second].high < found[best].low
        parts.append(
            f"; the best of another family, `{second}` ({others[0]}), has "
            f"{written(found[second], board)}, {_number(gap, board)} less, and their intervals "
            + ("do not overlap" if is_apart else "overlap")
        )
    parts.append(f". {_against(board, dataset, best)}")
    return "".join(parts)


def _against(board: Board, dataset: str, label: str) -> str:
    """The label beside the data's own mean."""
    own = board.data.get(dataset)
    if own is None:
        return "The data's own mean is not known."
    value = board.estimates[dataset][label].value
    times = f", {value / own:.1f} times as much" if own > 0 < value else ""
    more = "above" if value >= own else "below"
    return (
        f"The data's own mean is {_number(own, board)}: it is {_number(abs(value - own), board)} "
        f"{more}{times}."
    )


def _number(value: float, board: Board) -> str:
    unit = f" {board.column.unit}" if board.column.unit else ""
    return format_number(value, board.column) + unit


def families(board: Board) -> list[str]:
    """How often each family has the best algorithm, and how far its best is from it on average.

    Of one dataset, `winners` has said it.
    """
    if len(board.estimates) < 2:
        return []
    firsts = {dataset: board.bests(dataset) for dataset in board.estimates}
    names = list(dict.fromkeys(board.families.values()))
    sentences = []
    for name in names:
        there = [dataset for dataset, best in firsts.items() if name in best]
        if not there:
            continue
        won = [short(dataset) for dataset in there if next(iter(firsts[dataset])) == name]
        behind = [
            board.estimates[d][board.ranking(d)[0]].value
            - board.estimates[d][firsts[d][name]].value
            for d in there
        ]
        where = f" ({', '.join(won)})" if won else ""
        sentences.append(
            f"{name.capitalize()} has the best algorithm on {len(won)} of {len(there)} "
            f"datasets{where}; its best is {_number(float(np.mean(behind)), board)} behind the "
            f"best of all on average, and {_number(max(behind), board)} at most."
        )
    return sentences


def against_data(board: Board) -> list[str]:
    """Which algorithms improve on the data's own mean, which do not, and which are worse."""
    sentences = []
    for dataset, own in board.data.items():
        found = board.estimates[dataset]
        groups = {
            "above it, with the whole interval": [k for k, e in found.items() if e.low > own],
            "not told apart from it": [k for k, e in found.items() if e.low <= own <= e.high],
            "below it, with the whole interval": [k for k, e in found.items() if e.high < own],
        }
        parts = [f"{_names(names)} {text}" for text, names in groups.items() if names]
        if parts:
            mean = f"the data's mean {_number(own, board)}"
            sentences.append(f"On {short(dataset)}, beside {mean}: {'; '.join(parts)}.")
    return sentences


def _names(labels: list[str]) -> str:
    return ", ".join(f"`{label}`" for label in labels)


def surprises(board: Board, clean: Board, online: Mapping[str, float]) -> list[str]:
    """What one would not expect who knows half of the tables.

    Args:
        board: the main quantity.
        clean: clean success, by the same datasets and labels.
        online: the main quantity of algorithms that learned in the task.
    """
    sentences = [*_shifts(board), *_unclean(board, clean)]
    if online and board.estimates:
        label = max(online, key=lambda name: online[name])
        best = {d: board.estimates[d][board.ranking(d)[0]].value for d in board.estimates}
        above = [short(dataset) for dataset, value in best.items() if value > online[label]]
        sentences.append(
            f"The best online algorithm, `{label}`, has {_number(online[label], board)}; the best "
            f"offline one is above that on {len(above)} of {len(best)} datasets"
            + (f" ({', '.join(above)})." if above else ".")
        )
    return sentences


def _shifts(board: Board) -> Iterator[str]:
    """Algorithms that are among the first on one dataset and among the last on another."""
    rankings = {dataset: board.ranking(dataset) for dataset in board.estimates}
    for label in board.families:
        ranks = {d: names.index(label) + 1 for d, names in rankings.items() if label in names}
        if not ranks:
            continue
        high, low = min(ranks, key=lambda d: ranks[d]), max(ranks, key=lambda d: ranks[d])
        n_first, n_last = len(rankings[high]), len(rankings[low])
        if n_first < FEW_RANKS or ranks[high] > n_first / 4 or ranks[low] <= 3 * n_last / 4:
            continue
        yield (
            f"`{label}` is number {ranks[high]} of {n_first} on {short(high)} and number "
            f"{ranks[low]} of {n_last} on {short(low)}."
        )


def _unclean(board: Board, clean: Board) -> Iterator[str]:
    """Datasets on which another algorithm is best once contacts count."""
    for dataset, found in clean.estimates.items():
        if not found or not board.estimates.get(dataset):
            continue
        first, cleanest = board.ranking(dataset)[0], clean.ranking(dataset)[0]
        if first in found and first not in clean.leaders(dataset):
            yield (
                f"On {short(dataset)}, the best by {board.column.label} is not the cleanest: "
                f"`{first}` solves {written(found[first], clean)} of the episodes without a "
                f"touch, `{cleanest}` {written(found[cleanest], clean)}."
            )


def failures(board: Board, missing: Mapping[str, str]) -> list[str]:
    """What did not work: no better than no skill, seeds that differ widely, cells without results.

    Args:
        board: the main quantity.
        missing: cells that are not done, with the reason.
    """
    worse = [
        (label, short(dataset))
        for label in board.families
        for dataset, found in board.estimates.items()
        if board.column.key == "score" and label in found and found[label].high < 0
    ]
    sentences = [
        f"`{label}` is below no skill, with the whole interval, on "
        f"{', '.join(dataset for _, dataset in group)}."
        for label, group in groupby(worse, key=lambda pair: pair[0])
    ]
    sentences += _spread(board)
    sentences += _absent(missing)
    return sentences or ["No cell failed, and no algorithm ended below no skill."]


MOST_NAMED = 6
"""Algorithms that a sentence names; more are counted."""


def _absent(missing: Mapping[str, str]) -> Iterator[str]:
    """One sentence for all cells of a dataset that have no results for one reason."""
    for reason in dict.fromkeys(missing.values()):
        labels: dict[str, list[str]] = {}
        for name in (name for name, why in missing.items() if why == reason):
            label, _, dataset = name.rpartition("/")
            labels.setdefault(dataset, []).append(f"`{label}`")
        for dataset, found in labels.items():
            who = ", ".join(found) if len(found) <= MOST_NAMED else f"{len(found)} algorithms"
            yield f"On {dataset}, {who} {'have' if len(found) > 1 else 'has'} no results: {reason}."


def _spread(board: Board) -> Iterator[str]:
    """The widest interval of the board, which one should look at before trusting a mean."""
    widths = {
        (label, dataset): each.high - each.low
        for dataset, found in board.estimates.items()
        for label, each in found.items()
    }
    if not widths:
        return
    label, dataset = max(widths, key=lambda pair: widths[pair])
    yield (
        f"Training seeds differ most for `{label}` on {short(dataset)}: "
        f"{written(board.estimates[dataset][label], board)}."
    )
