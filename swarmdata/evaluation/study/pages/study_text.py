"""The findings of a study in sentences that are computed from its numbers."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from swarmdata.evaluation.results.estimate_table import format_number
from swarmdata.evaluation.results.result_tables import estimate_values
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.evaluation.study.pages.study_tables import format_with_unit
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version
from swarmdata.types import Double

MIN_RANKED = 4
"""With fewer algorithms on a dataset, ranks are too coarse for a rank shift to be a surprise."""

GOOD_DATA = 70.0
"""The mean score from which data count as good: experts have 100, medium-expert tiers 72 to 86."""

MAX_NAMED_ALGORITHMS = 6
"""Algorithms that a sentence names; more are counted."""


def winners(board: Scoreboard) -> list[str]:
    """Which algorithm and which family is best on each dataset, and by how much."""
    return [_winner(board, dataset) for dataset in board.estimates if board.estimates[dataset]]


def ablations_ahead(board: Scoreboard, whole: Scoreboard) -> list[str]:
    """Datasets on which rows that the board leaves out clearly exceed its best one.

    Args:
        board: without ablations.
        whole: with them.
    """
    sentences = []
    for dataset in (name for name, found in board.estimates.items() if found):
        best = board.ranking(dataset)[0]
        left_out = [label for label in whole.ranking(dataset) if label not in board.families]
        leads = {label: whole.lead(dataset, label, best) for label in left_out}
        ahead = [
            f"`{label}` by {format_with_unit(lead, whole)}"
            for label, lead in leads.items()
            if lead.low > 0.0
        ]
        if ahead:
            sentences.append(
                f"Ablations do not count as algorithms; on {without_version(dataset)}, some are "
                f"clearly better than the best algorithm, `{best}`, paired by episode: "
                f"{', '.join(ahead)}."
            )
    return sentences


def _winner(board: Scoreboard, dataset: str) -> str:
    found, families = board.estimates[dataset], board.best_by_family(dataset)
    family, *others = families
    best = families[family]
    name, result = without_version(dataset), format_with_unit(found[best], board)
    sentences = [f"On {name}, `{best}` ({family}) is best with {result}."]
    if others:
        second = families[others[0]]
        lead = board.lead(dataset, best, second)
        sentences.append(
            f"The best algorithm of another family, `{second}` ({others[0]}), reaches "
            f"{format_with_unit(found[second], board)}, which is {format_with_unit(lead, board)} "
            f"less, paired by episode{'' if lead.low > 0.0 else '; this may be chance'}."
        )
    elif len(_measured_families(board)) > 1:
        sentences.append("No other family was measured there.")
    return " ".join([*sentences, _compare_with_data(board, dataset, best)])


def _compare_with_data(board: Scoreboard, dataset: str, label: str) -> str:
    data_mean = board.data.get(dataset)
    if data_mean is None:
        return "The mean of the data is not known."
    found = board.estimates[dataset][label]
    is_above = found.value >= data_mean
    ratio = f" ({found.value / data_mean:.1f} times as much)" if data_mean > 0 < found.value else ""
    ends = (each - data_mean for each in found)
    gap = Estimate(*ends) if is_above else Estimate(*(-e for e in _swapped(*ends)))
    return (
        f"The mean of the data is {_number(data_mean, board)}; `{label}` is "
        f"{format_with_unit(gap, board)} {'above' if is_above else 'below'} it{ratio}."
    )


def _swapped(value: float, low: float, high: float) -> Estimate:
    return Estimate(value, high, low)


def _number(value: float, board: Scoreboard) -> str:
    unit = f" {board.column.unit}" if board.column.unit else ""
    return format_number(value, board.column) + unit


def _measured_families(board: Scoreboard) -> list[str]:
    """Families with a result on any dataset."""
    measured = {name for dataset in board.estimates for name in board.best_by_family(dataset)}
    return [name for name in dict.fromkeys(board.families.values()) if name in measured]


class FamilyRecord(NamedTuple):
    """How the best algorithm of a family compares with the best of all, over datasets."""

    name: str
    won: list[str]  # datasets on which it is the best of all
    behind: list[float]  # how far it is behind, on each dataset on which the family was measured


def _counted_datasets(board: Scoreboard) -> list[str]:
    """Datasets on which more than half of the families were measured.

    On others a family would win for want of others. Empty if there is only one, where `winners`
    says the same.
    """
    n_families = len(_measured_families(board))
    counted = [d for d in board.estimates if 2 * len(board.best_by_family(d)) > n_families]
    return counted if len(counted) > 1 else []


def _family_records(board: Scoreboard) -> list[FamilyRecord]:
    """The records of all families that were measured on the datasets that count."""
    firsts = {dataset: board.best_by_family(dataset) for dataset in _counted_datasets(board)}
    records = []
    for name in _measured_families(board):
        tried = [dataset for dataset, best in firsts.items() if name in best]
        won = [without_version(dataset) for dataset in tried if next(iter(firsts[dataset])) == name]
        behind = [
            board.estimates[d][board.ranking(d)[0]].value
            - board.estimates[d][firsts[d][name]].value
            for d in tried
        ]
        records += [FamilyRecord(name, won, behind)] if tried else []
    return records


def families(board: Scoreboard) -> list[str]:
    """How often each family has the best algorithm, and how far behind its best algorithm is."""
    records = _family_records(board)
    if not records:
        return []
    sentences = []
    for name, won, behind in records:
        where = f" ({', '.join(won)})" if won else ""
        sentences.append(
            f"{_capital(name)} has the best algorithm on {len(won)} of {len(behind)} "
            f"datasets{where}. Its best algorithm is {_number(float(np.mean(behind)), board)} "
            f"behind the overall best on average, and at most {_number(max(behind), board)}."
        )
    counted = _counted_datasets(board)
    if left_out := [without_version(d) for d in board.estimates if d not in counted]:
        sentences.append(
            f"Not counted: {', '.join(left_out)}, where at most half of the families were measured."
        )
    return sentences


def best_families(board: Scoreboard) -> str:
    """Which families have the best algorithm, and how far behind the others are, in two sentences.

    Scores on good data and on the rest are counted apart. The second sentence is of the families
    that were measured on all datasets that count. Empty where `families` is.
    """
    records, counted = _family_records(board), _counted_datasets(board)
    if not records:
        return ""
    good = [d for d in counted if board.data.get(d, -math.inf) >= GOOD_DATA]
    rest = [d for d in counted if d not in good]
    if board.column.key == "score" and good and rest:
        wins = (
            f"Of data that score below {GOOD_DATA:g}, where experts have 100, "
            f"{_wins(records, rest)}; of better data, {_wins(records, good)}"
        )
    else:
        wins = _capital(_wins(records, counted))
    whole = [each for each in records if len(each.behind) == len(counted)]
    gaps = sorted((float(np.mean(each.behind)), each.name) for each in whole)
    shown = ", ".join(f"{_number(gap, board)} ({name})" for gap, name in gaps)
    return (
        f"{wins}. On average the best algorithm of a family is behind the best of all by {shown}."
    )


def _wins(records: Sequence[FamilyRecord], datasets: Sequence[str]) -> str:
    """How often each family has the best algorithm on some datasets, most often first."""
    names = {without_version(dataset) for dataset in datasets}
    won = {each.name: len(names.intersection(each.won)) for each in records}
    first, *others = sorted((name for name in won if won[name]), key=lambda name: -won[name])
    several = f"{len(names)} dataset{'s' if len(names) > 1 else ''}"
    return ", ".join(
        [
            f"{first} has the best algorithm on {won[first]} of {several}",
            *(f"{name} on {won[name]}" for name in others),
        ]
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def against_data(board: Scoreboard) -> list[str]:
    """Which algorithms improve on the mean of the data, which do not, and which are worse.

    The mean of all episodes of a dataset is a known number, and they are other episodes than those
    of the evaluation: nothing is paired, and only the interval of the algorithm counts.
    """
    sentences = []
    for dataset, mean in board.data.items():
        found = board.estimates[dataset]
        groups = {
            "above it with the whole interval": [k for k, e in found.items() if e.low > mean],
            "within the interval": [
                k for k, e in found.items() if not (e.low > mean or e.high < mean)
            ],
            "below it with the whole interval": [k for k, e in found.items() if e.high < mean],
        }
        parts = [
            f"{text}: {', '.join(f'`{label}`' for label in labels)}"
            for text, labels in groups.items()
            if labels
        ]
        if parts:
            name, shown = without_version(dataset), _number(mean, board)
            sentences.append(f"{name}, where the mean of the data is {shown}: {'; '.join(parts)}.")
    return sentences


def surprises(
    board: Scoreboard, clean: Scoreboard, online: Mapping[str, Mapping[str, Double]]
) -> list[str]:
    """Results that the tables of scores alone do not suggest.

    Args:
        board: the main quantity.
        clean: clean success, for the same datasets and labels.
        online: dataset -> algorithms that learned in its world -> the main quantity,
            [runs, episodes].
    """
    return [*_rank_shifts(board), *_unclean_winners(board, clean), *_beside_online(board, online)]


def _beside_online(board: Scoreboard, online: Mapping[str, Mapping[str, Double]]) -> Iterator[str]:
    """On how many datasets of a world offline algorithms exceed those that learned in it."""
    worlds: dict[tuple[str, ...], list[str]] = {}
    for dataset in board.values:
        if labels := tuple(online.get(dataset, ())):
            worlds.setdefault(labels, []).append(dataset)
    for labels, datasets in worlds.items():
        values = online[datasets[0]]
        label = max(labels, key=lambda name: float(values[name].mean()))
        above = [
            without_version(dataset)
            for dataset in datasets
            if difference_interval(
                board.values[dataset][board.ranking(dataset)[0]], values[label]
            ).low
            > 0.0
        ]
        yield (
            f"The best online algorithm, `{label}`, reaches "
            f"{format_with_unit(estimate_values(values[label], board.column), board)}; the best "
            f"offline algorithm clearly exceeds it, paired by episode, on {len(above)} of "
            f"{len(datasets)} datasets" + (f" ({', '.join(above)})." if above else ".")
        )


def _rank_shifts(board: Scoreboard) -> Iterator[str]:
    """Algorithms in the top quarter on one dataset and in the bottom quarter on another."""
    rankings = {dataset: board.ranking(dataset) for dataset in board.estimates}
    for label in board.families:
        ranks = {d: names.index(label) + 1 for d, names in rankings.items() if label in names}
        if not ranks:
            continue
        high, low = min(ranks, key=lambda d: ranks[d]), max(ranks, key=lambda d: ranks[d])
        n_first, n_last = len(rankings[high]), len(rankings[low])
        if n_first < MIN_RANKED or ranks[high] > n_first / 4 or ranks[low] <= 3 * n_last / 4:
            continue
        yield (
            f"`{label}` has rank {ranks[high]} of {n_first} on {without_version(high)}, but rank "
            f"{ranks[low]} of {n_last} on {without_version(low)}."
        )


def _unclean_winners(board: Scoreboard, clean: Scoreboard) -> Iterator[str]:
    """Datasets on which the best algorithm is not the one with the highest clean success."""
    for dataset, found in clean.estimates.items():
        if not found or not board.estimates.get(dataset):
            continue
        first, cleanest = board.ranking(dataset)[0], clean.ranking(dataset)[0]
        if first in found and first not in clean.leaders(dataset):
            yield (
                f"On {without_version(dataset)}, the algorithm with the best {board.column.label} "
                f"is not the cleanest: `{first}` solves {format_with_unit(found[first], clean)} of "
                f"the episodes without a contact, `{cleanest}` "
                f"{format_with_unit(found[cleanest], clean)}."
            )


def failures(board: Scoreboard, missing: Mapping[str, str]) -> list[str]:
    """Scores below no skill, the widest interval, and cells without results.

    Args:
        board: the main quantity.
        missing: cells that are not done, with the reason.
    """
    worse = [
        (label, without_version(dataset))
        for label in board.families
        for dataset, found in board.estimates.items()
        if board.column.key == "score" and label in found and found[label].high < 0
    ]
    sentences = [
        f"`{label}` scores below no skill with its whole interval on "
        f"{', '.join(dataset for _, dataset in group)}."
        for label, group in groupby(worse, key=lambda pair: pair[0])
    ]
    sentences += _widest_interval(board)
    sentences += _missing_results(missing)
    return sentences or ["No cell failed, and no algorithm scored below no skill."]


def _missing_results(missing: Mapping[str, str]) -> Iterator[str]:
    """One sentence for all cells of a dataset that lack results for the same reason."""
    for reason in dict.fromkeys(missing.values()):
        labels: dict[str, list[str]] = {}
        for name in (name for name, why in missing.items() if why == reason):
            label, _, dataset = name.rpartition("/")
            labels.setdefault(dataset, []).append(f"`{label}`")
        for dataset, found in labels.items():
            who = (
                ", ".join(found)
                if len(found) <= MAX_NAMED_ALGORITHMS
                else f"{len(found)} algorithms"
            )
            yield f"On {dataset}, {who} {'have' if len(found) > 1 else 'has'} no results: {reason}."


def _widest_interval(board: Scoreboard) -> Iterator[str]:
    """The widest interval of the board: a reason to doubt that mean."""
    widths = {
        (label, dataset): each.high - each.low
        for dataset, found in board.estimates.items()
        for label, each in found.items()
        if not math.isnan(each.low)
    }
    if not widths:
        return
    label, dataset = max(widths, key=lambda pair: widths[pair])
    yield (
        f"The widest interval is that of `{label}` on "
        f"{without_version(dataset)}: {format_with_unit(board.estimates[dataset][label], board)}."
    )
