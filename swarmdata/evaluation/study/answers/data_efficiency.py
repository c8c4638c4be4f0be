"""Data efficiency: what smaller parts of the same data cost."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages.data_efficiency_section import (
    SizedScores,
    size_table,
    sized_scores,
)
from swarmdata.evaluation.study.pages.row_differences import format_difference, verdict_of
from swarmdata.evaluation.study.pages.study_figures import plot_sizes
from swarmdata.rollouts.score_intervals import difference_interval


def answer_data_efficiency(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies that train on smaller parts of their datasets."""
    sentences, headlines, parts, figures, chosen = [], [], [], [], []
    for each in evidence:
        scores = sized_scores(each.found)
        if scores is not None:
            figure = f"data-efficiency-{each.name}.png"
            label = scores.board.column.label
            plot_sizes(scores.panels, scores.data, each.found.looks, out / figure, ylabel=label)
            sentences += [text for name in scores.ids for text in _sentences(scores, name)]
            headlines += [_headline(scores, name) for name in scores.ids]
            figures.append(figure)
            chosen.append(each)
            parts.append(
                f"![{label} by joint steps]({figure})\n\nStudy {each.name}; the dashed line is the "
                f"mean of those episodes. Updates are the same for all sizes.\n\n"
                f"{size_table(scores)}"
            )
    if not parts:
        return None
    headline = " ".join(headlines)
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def _headline(scores: SizedScores, dataset: str) -> str:
    """The best algorithm with the smallest and with the largest part."""
    board, ids = scores.board, scores.ids[dataset]
    shown = []
    for n_steps in (min(ids), max(ids)):
        best = board.ranking(ids[n_steps])[0]
        text = format_estimate(board.estimates[ids[n_steps]][best], board.column)
        shown.append(f"{text} (`{best}`)")
    return (
        f"With {min(ids):,} joint steps of {dataset}, the best {board.column.label} is "
        f"{shown[0]}, with {max(ids):,} {shown[1]}."
    )


def _sentences(scores: SizedScores, dataset: str) -> Iterator[str]:
    """For each smaller part: how many algorithms lose, which the most and the least."""
    board, ids = scores.board, scores.ids[dataset]
    largest, column = max(ids), scores.board.column
    for n_steps in sorted(ids, reverse=True):
        whole, part = board.values[ids[largest]], board.values[ids[n_steps]]
        changes = {
            label: difference_interval(part[label], whole[label])
            for label in part
            if label in whole
        }
        if n_steps == largest or not changes:
            continue
        ranked = sorted(changes, key=lambda label: -changes[label].value)
        n_lower = [verdict_of(change) for change in changes.values()].count("lower")
        best = board.ranking(ids[n_steps])[0]
        yield (
            f"On {dataset}, with {n_steps:,} joint steps instead of {largest:,}, the "
            f"{column.label} of {n_lower} of {len(changes)} algorithms falls clearly; from "
            f"{format_difference(changes[ranked[-1]], column)} (`{ranked[-1]}`) to "
            f"{format_difference(changes[ranked[0]], column)} (`{ranked[0]}`). The best then is "
            f"`{best}` with {format_estimate(board.estimates[ids[n_steps]][best], column)}."
        )
