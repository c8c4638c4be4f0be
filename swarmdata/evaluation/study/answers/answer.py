"""What every question's module returns: the text of an answer, its evidence and its figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.evaluation.study.answers.evidence import Evidence


@dataclass(frozen=True)
class Answer:
    """The body of a page.

    Attributes:
        headline: what the page says, computed from the results.
        sentences: all that follows from the results, likewise.
        details: tables and figures, as Markdown.
        evidence: the studies that it rests on.
        figures: names of the files that were drawn.
    """

    headline: str
    sentences: tuple[str, ...]
    details: str
    evidence: tuple[Evidence, ...]
    figures: tuple[str, ...]


Answering = Callable[[Sequence[Evidence], Path], Answer | None]
"""From all studies and the folder of figures to an answer; None: no study bears on the question."""


@dataclass(frozen=True)
class Question:
    """One page.

    Attributes:
        stem: of the page's file.
        title: the question.
        needs: what a study has to have to answer it.
        answer: the function that does.
        scope: how to read the page, in a sentence or two.
    """

    stem: str
    title: str
    needs: str
    answer: Answering
    scope: str
