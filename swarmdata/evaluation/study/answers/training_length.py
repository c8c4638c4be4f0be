"""How long to train: what doubling the updates changes."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.compared_rows import (
    compared_rows,
    count_sentences,
    plot_compared,
    tables_of,
)
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages.row_differences import doubling_sentences

DIFFERENCES = "doubling"
"""What studies call these pairs."""


def answer_training_length(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from the pairs that studies call `doubling`."""
    compared = compared_rows(evidence, DIFFERENCES)
    if not compared:
        return None
    sentences = [
        sentence
        for each in compared
        for plan in (each.evidence.found.study.differences[DIFFERENCES],)
        for sentence in doubling_sentences(each.evidence.found, plan)
    ]
    sentences += count_sentences(compared, "doubling the updates")
    figure = "training-length.png"
    plot_compared(compared, out / figure)
    details = f"![what doubling changes]({figure})\n\n{tables_of(compared)}"
    return Answer(tuple(sentences), details, tuple(each.evidence for each in compared), (figure,))
