"""How far from the data: what algorithms add to the data's mean and to a clone of the data."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED
from swarmdata.evaluation.results.result_tables import UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.answer_figures import plot_differences_from_zero
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.row_differences import (
    format_difference,
    main_column,
    verdict_of,
)
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard
from swarmdata.evaluation.study.plan import Study, Variant
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

CLONE = "bc"
"""The algorithm that copies the data."""


class Distance(NamedTuple):
    """How far an algorithm is from the data on a dataset."""

    dataset: str
    label: str
    from_mean: Estimate  # of the data: a known number, so nothing is paired
    from_clone: Estimate  # paired by episode


def answer_distance_from_data(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies on the reserved seeds that have a clone of the data."""
    chosen = [each for each in evidence if each.compares_rows and clone_of(each.found.study)]
    if not chosen:
        return None
    sentences, headlines, parts, figures = [], [], [], []
    for each in chosen:
        board = make_scoreboard(
            each.found.results, each.found.families, main_column(each.found).key
        )
        distances = list(_distances(board, clone_of(each.found.study)))
        sentences += [*_against_clone(distances, board), *study_text.against_data(board)]
        headlines.append(_headline(each, distances, board))
        best = {(d, k) for d in board.values for k in board.best_by_family(d).values()}
        drawn = [each for each in distances if (each.dataset, each.label) in best]
        figures.append(f"distance-from-data-{each.name}.png")
        _plot(drawn, board, out / figures[-1])
        parts.append(
            f"Study {each.name}, the best row of each family:\n\n"
            f"![{board.column.label} minus that of the data and of the clone]({figures[-1]})\n\n"
            f"All rows:\n\n{_table(distances, board)}"
        )
    headline = " ".join(headlines)
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def _headline(evidence: Evidence, distances: Sequence[Distance], board: Scoreboard) -> str:
    """On how many datasets some row is clearly better than the data, and than the clone."""
    above = {each.dataset for each in distances if verdict_of(each.from_mean) == "higher"}
    beaten = {each.dataset for each in distances if verdict_of(each.from_clone) == "higher"}
    return (
        f"In study {evidence.name}, some row is clearly above the mean of the data on "
        f"{len(above)} of {len(board.data)} datasets, and above a clone of the data on "
        f"{len(beaten)} of {len(board.estimates)}."
    )


def clone_of(study: Study) -> str:
    """The label of the plain clone; empty if the study has none."""
    return next((label for label, each in study.algorithms.items() if _is_plain_clone(each)), "")


def _is_plain_clone(variant: Variant) -> bool:
    return variant.algorithm == CLONE and not variant.settings and variant.rewards is None


def _distances(board: Scoreboard, clone: str) -> Iterator[Distance]:
    for dataset, estimates in board.estimates.items():
        mean = board.data.get(dataset)
        for label, found in estimates.items():
            from_mean = UNDEFINED_ESTIMATE if mean is None else Estimate(*(e - mean for e in found))
            is_paired = clone in estimates and label != clone
            from_clone = board.lead(dataset, label, clone) if is_paired else UNDEFINED_ESTIMATE
            yield Distance(dataset, label, from_mean, from_clone)


def _against_clone(distances: Sequence[Distance], board: Scoreboard) -> Iterator[str]:
    """Who adds something to a clone of the data, on each dataset."""
    for dataset in board.estimates:
        groups: dict[str, list[str]] = {"higher": [], "lower": [], "no clear change": []}
        for each in distances:
            if each.dataset == dataset and each.from_clone is not UNDEFINED_ESTIMATE:
                shown = format_difference(each.from_clone, board.column)
                groups[verdict_of(each.from_clone)].append(f"`{each.label}` {shown}")
        parts = [f"{kind}: {', '.join(names)}" for kind, names in groups.items() if names]
        if parts:
            yield (
                f"On {without_version(dataset)}, {board.column.label} minus that of the clone, "
                f"paired by episode: {'; '.join(parts)}."
            )


def _plot(distances: Sequence[Distance], board: Scoreboard, path: Path) -> None:
    groups: dict[str, dict[str, list[Estimate]]] = {}
    for each in distances:
        rows = groups.setdefault(without_version(each.dataset), {})
        rows[each.label] = [each.from_mean, each.from_clone]
    label = board.column.label
    labels = f"{label} minus the mean of the data", f"{label} minus the clone's"
    plot_differences_from_zero(groups, labels, path)


def _table(distances: Sequence[Distance], board: Scoreboard) -> str:
    rows = [
        (
            without_version(each.dataset),
            f"`{each.label}`",
            _cell(each.from_mean, board),
            _cell(each.from_clone, board),
        )
        for each in distances
    ]
    label = board.column.label
    head = ("dataset", "row", f"{label} minus the mean of the data", f"{label} minus the clone's")
    return markdown.table(head, rows)


def _cell(difference: Estimate, board: Scoreboard) -> str:
    if difference is UNDEFINED_ESTIMATE:
        return UNDEFINED
    return f"{format_difference(difference, board.column)}, {verdict_of(difference)}"
