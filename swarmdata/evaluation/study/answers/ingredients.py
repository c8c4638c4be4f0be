"""What the ingredients do: algorithms against themselves without what they are named after."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.compared_rows import (
    compared_rows,
    counted_verdicts,
    plot_compared,
    sentence_of,
    tables_of,
)
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.registry.ablations import ABLATIONS

DIFFERENCES = "ingredient"
"""What studies call these pairs."""


def answer_ingredients(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from the pairs that studies call `ingredient`."""
    compared = compared_rows(evidence, DIFFERENCES)
    if not compared:
        return None
    headline, sentences = counted_verdicts(compared, "the ingredient"), []
    for each in compared:
        for difference in each.differences:
            what = _ingredient(each.evidence, difference.one)
            sentences.append(
                f"{what[:1].upper()}{what[1:]} of `{difference.one}`, on {difference.dataset}: "
                f"{sentence_of(difference, each.columns)}."
            )
    figure = "ingredients.png"
    plot_compared(compared, out / figure)
    details = f"![with the ingredient minus without it]({figure})\n\n{tables_of(compared)}"
    studies = tuple(each.evidence for each in compared)
    return Answer(headline, tuple(sentences), details, studies, (figure,))


def _ingredient(evidence: Evidence, label: str) -> str:
    ablation = ABLATIONS[evidence.found.study.algorithms[label].algorithm]
    return "what was added" if ablation is None else ablation.ingredient
