"""Pages of questions: the sections of studies' reports that bear on each, and an index.

Text that stands above the made part of a page is the author's, and stays.
"""

import csv
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from swarmdata.cards.committed_studies import PLAN_FILE
from swarmdata.drawing import markdown
from swarmdata.drawing.page_text import MADE, page_with
from swarmdata.errors import StudyError
from swarmdata.evaluation.study.pages.distance import clone_of
from swarmdata.evaluation.study.pages.study_folder import BLOCK_NAMES, COSTS_FILE, REPORT_FILE
from swarmdata.evaluation.study.plan import Study
from swarmdata.runtime.output_folder import OutputKind, check_output, filled

STUDY_PAGES = OutputKind("folder of study pages")

INDEX_FILE = "README.md"

_LINK = re.compile(r"\]\((?![a-z]+:)([^)]+)\)")
"""A relative link or picture."""


@dataclass(frozen=True, eq=False)
class Report:
    """The report of a study."""

    folder: Path
    study: Study
    sections: dict[str, str]  # title -> body

    @property
    def compares_rows(self) -> bool:
        """Whether its cells on reserved seeds compare rows on data as recorded.

        Other studies have such cells too, beside those of other views and conditions, or of
        online algorithms.
        """
        plan = self.study
        has_others = plan.information or plan.tasks or plan.sweeps or plan.online
        return plan.block == "evaluation" and not has_others

    def section(self, title: str, out: Path) -> str:
        """A section as it stands in a page of another folder."""

        def moved(link: re.Match[str]) -> str:
            return f"]({Path(os.path.relpath(self.folder / link[1], out)).as_posix()})"

        return f"### {title}\n\n{_LINK.sub(moved, self.sections[title])}"


class Question(NamedTuple):
    """One page.

    Attributes:
        stem: of the page's file.
        title: the question.
        needs: what a study has to have to bear on it.
        sections: how titles of the sections begin that bear on it.
    """

    stem: str
    title: str
    needs: str
    sections: Callable[[Report], Sequence[str]]


def _pairs(report: Report, name: str) -> Sequence[str]:
    plan = report.study.differences.get(name)
    return [plan.title] if plan else []


QUESTIONS = (
    Question(
        "ingredients",
        "What do the ingredients do?",
        "pairs under `differences: ingredient`",
        lambda report: _pairs(report, "ingredient"),
    ),
    Question(
        "training-length",
        "How long to train?",
        "pairs under `differences: doubling`",
        lambda report: _pairs(report, "doubling"),
    ),
    Question(
        "data-regimes",
        "Which algorithm for which data?",
        "several datasets on the reserved seeds",
        lambda report: ["Score", "Return"] * (
            report.compares_rows and len(report.study.datasets) > 1
        ),
    ),
    Question(
        "online",
        "How far do algorithms get that learn in the task?",
        "`online` rows in the task of one of its datasets",
        lambda report: ["Online algorithms", "Convergence of online training"],
    ),
    Question(
        "information",
        "What does information cost?",
        "measured views under `information`",
        lambda report: ["Information: "],
    ),
    Question(
        "robustness",
        "How do they take worse radios and sensors than in training?",
        "measured `sweeps`",
        lambda report: ["Robustness: "],
    ),
    Question(
        "places",
        "Do they act in other places and larger teams?",
        "policies evaluated in other `tasks`",
        lambda report: ["Other places and sizes of teams"],
    ),
    Question(
        "data-efficiency",
        "How much data do they need?",
        "measured `sizes`",
        lambda report: ["Data efficiency"],
    ),
    Question(
        "safety",
        "How safe are they?",
        "results on the reserved seeds, or pairs under `differences: rewards`",
        lambda report: [
            *["Success and collisions"] * (report.compares_rows or bool(_pairs(report, "rewards"))),
            *_pairs(report, "rewards"),
        ],
    ),
    Question(
        "distance-from-data",
        "How far from the data do they get?",
        "a plain clone (`bc`) among its rows, on the reserved seeds",
        lambda report: ["Comparison with the data"] * (
            report.compares_rows and bool(clone_of(report.study))
        ),
    ),
)  # fmt: skip
"""The pages, in the order of the index."""


def write_result_pages(studies: Path, out: Path) -> tuple[list[Path], dict[str, str]]:
    """Writes the tables and figures of each question that some study bears on, and an index.

    Nothing is computed: they are those of the studies' reports.

    Args:
        studies: folder of studies, such as `cards/studies`.
        out: folder of the pages.

    Returns:
        The pages, the index first; and the pages that were left out, with the reason.

    Raises:
        OutputError: `out` has files that this did not write.
        StudyError: no study in the folder has a report.
    """
    check_output(out, STUDY_PAGES)
    reports = _read_reports(studies)
    bodies = {question: _body(question, reports, out) for question in QUESTIONS}
    left_out = {
        f"{question.stem}.md": f"no study has {question.needs}"
        for question, body in bodies.items()
        if not body
    }
    with filled(out, STUDY_PAGES) as folder:
        listed = []
        for question, body in bodies.items():
            file = out / f"{question.stem}.md"
            if body or file.exists():  # its text is the author's, its tables may be of the past
                made = body or f"No study here has {question.needs}."
                page = page_with(made, file, question.title)
                (folder / file.name).write_text(page, encoding="utf-8")
                listed.append(f"- [{question.title}]({file.name})\n")
        index = f"{''.join(listed)}\n{_coverage(reports, out)}"
        page = page_with(index, out / INDEX_FILE, "Results")
        (folder / INDEX_FILE).write_text(page, encoding="utf-8")
    written = [out / f"{question.stem}.md" for question, body in bodies.items() if body]
    return [out / INDEX_FILE, *written], left_out


def _read_reports(studies: Path) -> list[Report]:
    """Reads the reports of all studies in a folder, by name."""
    found = []
    for plan in sorted(studies.glob(f"*/{PLAN_FILE}")):
        if (plan.parent / REPORT_FILE).exists():
            text = (plan.parent / REPORT_FILE).read_text(encoding="utf-8").partition(MADE)[2]
            parts = (part.partition("\n") for part in text.split("\n## ")[1:])
            sections = {title: body.strip() for title, _, body in parts}
            found.append(Report(plan.parent, Study.from_file(plan), sections))
    if not found:
        raise StudyError(
            f"{studies} has no folder of a study with {PLAN_FILE} and {REPORT_FILE}. Pass the "
            "folder in which `swarmdata study` writes, such as cards/studies."
        )
    return found


def _body(question: Question, reports: Sequence[Report], out: Path) -> str:
    """The sections of each report that bear on a question, and what these studies cover."""
    parts, chosen = [], []
    for report in reports:
        begins = tuple(question.sections(report))
        titles = [title for title in report.sections if begins and title.startswith(begins)]
        if titles:
            chosen.append(report)
            sections = "\n\n".join(report.section(title, out) for title in titles)
            parts.append(f"## Study {report.study.name}\n\n{sections}\n")
    return "\n".join([*parts, f"## Studies\n\n{_coverage(chosen, out)}"]) if parts else ""


def _coverage(reports: Sequence[Report], out: Path) -> str:
    """A row for each study: what it covers, and what it took."""
    head = ("study", "rows", "datasets", "training seeds", "episodes", "cells",
            "hours of processor time")  # fmt: skip
    rows = []
    for report in reports:
        study = report.study
        with (report.folder / COSTS_FILE).open(encoding="utf-8", newline="") as file:
            seconds = [float(row["cpu_seconds"]) for row in csv.DictReader(file)]
        counts = (len(study.algorithms), len(study.datasets), len(study.seeds))
        link = Path(os.path.relpath(report.folder / REPORT_FILE, out)).as_posix()
        rows.append(
            (
                f"[{study.name}]({link})",
                *(f"{n:,}" for n in counts),
                f"{study.episodes:,} {BLOCK_NAMES[study.block]}",
                f"{len(seconds):,}",
                f"{sum(seconds) / 3600:.1f}",
            )
        )
    return markdown.table(head, rows)
