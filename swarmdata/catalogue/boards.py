"""Leaderboards: the results on each dataset, best first, with what does not compare set apart."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from swarmdata.catalogue.result_sources import Outcome, ResultSource
from swarmdata.drawing.style import family_name
from swarmdata.registry.components import OFFLINE_ALGORITHMS

Group = Literal["algorithms", "variants", "others"]

GROUPS: Mapping[str, str] = {
    "algorithms": "algorithms, one budget",
    "variants": "ablations and variants",
    "others": "other budgets and studies",
}
"""What the rows of a board are: name in the address, and label."""


@dataclass(frozen=True)
class Row:
    """One result on a board."""

    source: ResultSource
    outcome: Outcome
    group: Group


@dataclass(frozen=True)
class Board:
    """The results on one dataset."""

    dataset: str  # its id; after @, that it was observed through other models
    rows: tuple[Row, ...]  # the best first
    study: ResultSource | None
    """Whose algorithms, at one budget, are the first group; None: there are none."""
    data: float | None  # mean score of the dataset's own episodes; None: not known

    @property
    def quantity(self) -> str:
        """The score where all have it, else the return."""
        return "score" if all("score" in r.outcome.estimates for r in self.rows) else "return"

    @property
    def name(self) -> str:
        """The id of the dataset, without its view."""
        return self.dataset.partition("@")[0]

    def of(self, group: Group) -> list[Row]:
        """The rows of a group."""
        return [row for row in self.rows if row.group == group]


def boards(sources: Sequence[ResultSource]) -> list[Board]:
    """Returns the leaderboards, in the order of their datasets."""
    found: dict[str, list[tuple[ResultSource, Outcome]]] = {}
    for source, outcome in _distinct(sources):
        found.setdefault(outcome.dataset, []).append((source, outcome))
    return [_board(dataset, found[dataset]) for dataset in sorted(found)]


def _board(dataset: str, found: Sequence[tuple[ResultSource, Outcome]]) -> Board:
    """The committed study with the most algorithms at one budget gives the first group."""
    plain = [(s, o) for s, o in found if _is_algorithm(o) and not s.is_own]
    counts = Counter((source.place, outcome.updates) for source, outcome in plain)
    main = min(counts, key=lambda key: (-counts[key], key)) if counts else ("", "")

    def group(source: ResultSource, outcome: Outcome) -> Group:
        is_main = source.is_own or (source.place, outcome.updates) == main
        if _is_algorithm(outcome) or (source.is_own and not _is_variant(outcome)):
            return "algorithms" if is_main else "others"
        return "variants" if source.is_own or source.place == main[0] else "others"

    rows = sorted(
        (Row(source, outcome, group(source, outcome)) for source, outcome in found),
        key=lambda row: (*_rank(row.outcome), row.outcome.label),
    )
    data = next((s.data[dataset] for s, _ in found if dataset in s.data), None)
    study = next((source for source, _ in found if source.place == main[0]), None)
    return Board(dataset, tuple(rows), study, data)


def _is_algorithm(outcome: Outcome) -> bool:
    """Whether it is an algorithm as it is registered, on the recorded rewards."""
    return outcome.label in OFFLINE_ALGORITHMS and not outcome.rewards


def _is_variant(outcome: Outcome) -> bool:
    return bool(outcome.rewards) or family_name(outcome.family) == "ablations"


def _rank(outcome: Outcome) -> tuple[int, float]:
    """Sorts the best first: those with a score, then those with a return, which has no scale."""
    for k, name in enumerate(("score", "return")):
        found = outcome.estimates.get(name)
        if found is not None and not math.isnan(found.value):
            return k, -found.value
    return 2, 0.0


def _distinct(sources: Sequence[ResultSource]) -> list[tuple[ResultSource, Outcome]]:
    """The outcomes; what several sources measured alike, such as shared cells, is there once."""
    found: dict[tuple[object, ...], tuple[ResultSource, Outcome]] = {}
    for source in sorted(sources, key=lambda each: -len(each.outcomes)):
        for each in source.outcomes:
            numbers = tuple(sorted((name, repr(value)) for name, value in each.estimates.items()))
            key = (each.dataset, each.label, each.rewards, each.n_runs, each.updates, numbers)
            found.setdefault(key, (source, each))
    return list(found.values())
