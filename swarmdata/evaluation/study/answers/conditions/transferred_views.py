"""Transfer in an answer: policies that learned in one view and are used in another."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from swarmdata.evaluation.results.result_tables import QUANTITIES, Quantity
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.shifts.shift_table import TRANSFER_FILE, Shifted, read_shifts

SUCCESS = QUANTITIES["success"]

Matrix = Mapping[str, Mapping[str, float]]
"""View of the training -> view of the use -> solved episodes, %."""


class TransferText(NamedTuple):
    """What a page says of the transfers of a study on one dataset."""

    sentences: list[str]
    details: str
    figures: list[str]


def describe_transfers(evidence: Evidence, dataset: str, out: Path) -> TransferText:
    """A sentence and a figure for each row of the study whose policies were tried elsewhere.

    Args:
        evidence: the study.
        dataset: short name.
        out: folder of the figures.
    """
    text = TransferText([], "", [])
    rows = [row for row in read_shifts(evidence.folder / TRANSFER_FILE) if row.dataset == dataset]
    for label in dict.fromkeys(row.label for row in rows):
        found = _matrix([row for row in rows if row.label == label], SUCCESS)
        losses = _losses(found)
        if losses:
            figure = f"information-{evidence.name}-{dataset}-{label}-transfer.png"
            plot_score_matrix(found, out / figure, label=SUCCESS.column.header, decimals=0)
            text.sentences.append(_sentence(dataset, label, losses, found))
            text.sentences.extend(teachers(dataset, label, found))
            text.figures.append(figure)
            details = (
                f"Episodes solved (%) by `{label}` on {dataset}: a row is the view that policies "
                f"learned in, a column that of their use; empty where they do not fit.\n\n"
                f"![episodes solved by views of training and use]({figure})\n\n"
            )
            text = text._replace(details=text.details + details)
    return text


def teachers(dataset: str, label: str, found: Matrix) -> list[str]:
    """Which view to learn with solves most in each view of use, where that is not always the same.

    Views of use count in which policies of that view and of others were tried.
    """
    tried = {
        used: {learned: values[used] for learned, values in found.items() if used in values}
        for used in found
    }
    best = {
        used: max(values, key=lambda learned: (values[learned], learned == used))
        for used, values in tried.items()
        if used in values and len(values) > 1
    }
    elsewhere = Counter(learned for used, learned in best.items() if learned != used)
    if not elsewhere:
        return []
    teacher, n_won = elsewhere.most_common(1)[0]
    gains = {
        used: tried[used][teacher] - tried[used][used] for used in best if best[used] == teacher
    }
    used = max(gains, key=lambda view: gains[view])
    n_own = len(best) - elsewhere.total()
    return [
        f"On {dataset}, in {n_own} of {len(best)} views of use `{label}` solves most if it learned "
        f"with the same view, and in {n_won} if it learned with `{teacher}`; most of all with "
        f"`{used}`: {tried[used][teacher]:.0f} % instead of {tried[used][used]:.0f} %."
    ]


def _matrix(rows: Sequence[Shifted], quantity: Quantity) -> Matrix:
    column = quantity.column
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        if column.key in row.estimates:
            learned = found.setdefault(row.trained_with, {})
            learned[row.used_with] = column.factor * row.estimates[column.key].value
    return found


def _losses(found: Matrix) -> dict[tuple[str, str], float]:
    """Views of training and use -> how much less is solved than by those that learned there."""
    return {
        (learned, used): found[used][used] - value
        for learned, values in found.items()
        for used, value in values.items()
        if used != learned and used in found.get(used, {})
    }


def _sentence(
    dataset: str, label: str, losses: Mapping[tuple[str, str], float], found: Matrix
) -> str:
    """The mean loss, and the pair of views with the largest."""
    learned, used = max(losses, key=lambda pair: losses[pair])
    mean = sum(losses.values()) / len(losses)
    return (
        f"On {dataset}, in {len(losses)} pairs of views `{label}` solves {mean:.0f} percentage "
        f"points of the episodes less where it learned with another view than it is used with; "
        f"most between `{learned}` and `{used}`: {found[learned][used]:.0f} % instead of "
        f"{found[used][used]:.0f} %."
    )
