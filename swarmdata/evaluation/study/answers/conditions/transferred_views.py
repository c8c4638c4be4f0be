"""Transfer in an answer: policies that learned in one view and are used in another."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from swarmdata.evaluation.results.result_tables import QUANTITIES, Quantity
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.shifts.shift_table import TRANSFER_FILE, Shifted, read_shifts

Matrix = Mapping[str, Mapping[str, float]]
"""View of the training -> view of the use -> what was measured, in shown units."""

FEW = 20.0
"""Percent of the episodes; where no view solves more, scores tell views apart."""


CLEAR = 1.0
"""Percentage points or scores; smaller advantages are not spoken of."""


class Measure(NamedTuple):
    """A quantity, and how sentences speak of it."""

    quantity: Quantity
    what: str  # the caption's beginning
    verb: str
    less: str  # of a number
    unit: str


SUCCESS = Measure(
    QUANTITIES["success"], "Episodes solved (%) by", "solves",
    "percentage points of the episodes less", " %",
)  # fmt: skip
SCORE = Measure(QUANTITIES["score"], "Scores of", "scores", "less", "")


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
        own = [row for row in rows if row.label == label]
        measure, found = measured(own)
        losses = _losses(found)
        if losses:
            figure = f"information-{evidence.name}-{dataset}-{label}-transfer.png"
            header = measure.quantity.column.header
            plot_score_matrix(found, out / figure, label=header, decimals=0)
            text.sentences.append(_sentence(dataset, label, losses, found, measure))
            text.sentences.extend(teachers(dataset, label, found, measure))
            text.sentences.extend(all_round(dataset, label, found, measure))
            text.figures.append(figure)
            details = (
                f"{measure.what} `{label}` on {dataset}: a row is the view that policies "
                f"learned in, a column that of their use; empty where they do not fit.\n\n"
                f"![{header} by views of training and use]({figure})\n\n"
            )
            text = text._replace(details=text.details + details)
    return text


def measured(rows: Sequence[Shifted]) -> tuple[Measure, Matrix]:
    """The solved episodes of views that fit others, or the scores where few are solved."""
    solved, scores = (_matrix(rows, each.quantity) for each in (SUCCESS, SCORE))
    is_few = all(value < FEW for values in solved.values() for value in values.values())
    return (SCORE, fitting(scores)) if is_few and scores else (SUCCESS, fitting(solved))


def fitting(found: Matrix) -> Matrix:
    """Leaves out views whose inputs no other view has."""
    others = [
        (learned, used) for learned, values in found.items() for used in values if learned != used
    ]
    fit = {view for pair in others for view in pair}
    return {view: values for view, values in found.items() if view in fit}


def teachers(dataset: str, label: str, found: Matrix, measure: Measure = SUCCESS) -> list[str]:
    """Which view to learn with is best in each view of use, where that is not always the same.

    Views of use count in which policies of that view and of others were tried. The same view is the
    best unless another is better by `CLEAR`.
    """
    tried = {
        used: {learned: values[used] for learned, values in found.items() if used in values}
        for used in found
    }
    best = {
        used: max(values, key=lambda learned: values[learned] + CLEAR * (learned == used))
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
        f"On {dataset}, in {n_own} of {len(best)} views of use `{label}` {measure.verb} most if it "
        f"learned with the same view, and in {n_won} if it learned with `{teacher}`; most of all "
        f"with `{used}`: {tried[used][teacher]:.0f}{measure.unit} instead of "
        f"{tried[used][used]:.0f}{measure.unit}."
    ]


def all_round(dataset: str, label: str, found: Matrix, measure: Measure = SUCCESS) -> list[str]:
    """Which view to learn with is best where it is worst, of three or more that fit one another."""
    n_views = len(found)
    least = {
        learned: min(values.values()) for learned, values in found.items() if len(values) == n_views
    }
    if n_views < 3 or len(least) < 2:
        return []
    second, best = sorted(least, key=lambda learned: least[learned])[-2:]
    if least[best] - least[second] < CLEAR:
        return []
    return [
        f"On {dataset}, `{label}` that learned with `{best}` {measure.verb} "
        f"{least[best]:.0f}{measure.unit} or more with each of the {n_views} views, after "
        f"`{second}`: {least[second]:.0f}{measure.unit}."
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
    """Views of training and use -> how far behind those that learned there."""
    return {
        (learned, used): found[used][used] - value
        for learned, values in found.items()
        for used, value in values.items()
        if used != learned and used in found.get(used, {})
    }


def _sentence(
    dataset: str,
    label: str,
    losses: Mapping[tuple[str, str], float],
    found: Matrix,
    measure: Measure,
) -> str:
    """The mean loss, and the pair of views with the largest."""
    learned, used = max(losses, key=lambda pair: losses[pair])
    mean = sum(losses.values()) / len(losses)
    return (
        f"On {dataset}, in {len(losses)} pairs of views `{label}` {measure.verb} {mean:.0f} "
        f"{measure.less} where it learned with another view than it is used with; most between "
        f"`{learned}` and `{used}`: {found[learned][used]:.0f}{measure.unit} instead of "
        f"{found[used][used]:.0f}{measure.unit}."
    )
