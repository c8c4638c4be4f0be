"""Finished studies as evidence: what their archives hold, and what limits it."""

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from swarmdata.cards.committed_studies import PLAN_FILE
from swarmdata.errors import StudyError
from swarmdata.evaluation.study.pages.cell_archive import ARCHIVE_FILE, read_archive
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.study_folder import BLOCK_NAMES, REPORT_FILE
from swarmdata.evaluation.study.pages.study_tables import (
    epochs_of,
    hidden_widths,
    number_range,
)
from swarmdata.evaluation.study.plan import Study

ABLATIONS = "ablations"
"""What studies call the family of rows without the ingredient that they are named after."""

MAX_NAMED_CELLS = 8
"""Cells without results that a page names; more are counted."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A finished study: its folder, and what its cells found."""

    folder: Path
    found: Findings

    @property
    def name(self) -> str:
        """The name of the study."""
        return self.found.study.name

    @property
    def families(self) -> dict[str, str]:
        """The family of each row that is no ablation, in the order of the plan."""
        known = self.found.families
        return {label: family for label, family in known.items() if family != ABLATIONS}

    @property
    def is_on_reserved_seeds(self) -> bool:
        """Whether the episodes were read once, for results, and not to choose settings."""
        return self.found.study.block == "evaluation"

    @property
    def compares_rows(self) -> bool:
        """Whether its cells on reserved seeds compare rows on data as recorded.

        Other studies have such cells too, beside those of other views and conditions, or of
        online algorithms.
        """
        plan = self.found.study
        has_others = plan.information or plan.tasks or plan.sweeps or plan.online
        return self.is_on_reserved_seeds and not has_others


@contextmanager
def open_evidence(studies: Path) -> Iterator[tuple[list[Evidence], dict[str, str]]]:
    """Reads the archives of all studies in a folder; they are unpacked meanwhile.

    Args:
        studies: with a folder of each study.

    Yields:
        The studies, those with the most cells first, and why folders with a plan are left out.

    Raises:
        StudyError: no study in the folder has an archive.
    """
    plans = sorted(studies.glob(f"*/{PLAN_FILE}"))
    left_out = {
        plan.parent.name: f"it has no {ARCHIVE_FILE}, so its episodes are not known"
        for plan in plans
        if not (plan.parent / ARCHIVE_FILE).exists()
    }
    with ExitStack() as stack:
        evidence = []
        for plan in plans:
            if plan.parent.name not in left_out:
                work = Path(stack.enter_context(tempfile.TemporaryDirectory()))
                found, _ = read_archive(Study.from_file(plan), plan.parent / ARCHIVE_FILE, work)
                evidence.append(Evidence(plan.parent, found))
        if not evidence:
            raise StudyError(
                f"{studies} has no folder of a study with {PLAN_FILE} and {ARCHIVE_FILE}. Pass the "
                "folder in which `swarmdata study` writes, such as cards/studies."
            )
        evidence.sort(key=lambda each: (-len(each.found.cells), each.name))
        yield evidence, left_out


def limits(evidence: Sequence[Evidence], out: Path) -> str:
    """What the studies behind a page cover, and what has not been run, as a list."""
    return "".join(f"- {_limits(each, out)}\n" for each in evidence)


def _limits(evidence: Evidence, out: Path) -> str:
    found, study = evidence.found, evidence.found.study
    cells = [cell for cell in found.cells if cell.kind == "offline"]
    report = Path(os.path.relpath(evidence.folder / REPORT_FILE, out)).as_posix()
    updates = number_range(sorted({cell.n_updates for cell in cells}))
    batches = number_range(sorted({cell.config["batch_size"] for cell in cells}))
    chosen = (
        ""
        if evidence.is_on_reserved_seeds
        else "Settings are chosen on these episodes, which flatters them a little. "
    )
    return (
        f"[{study.name}]({report}): {_count(len(study.algorithms), 'row')} on "
        f"{_count(len(study.datasets), 'dataset')}, {_count(len(study.seeds), 'training seed')}, "
        f"{study.episodes:,} {BLOCK_NAMES[study.block]} episodes; {updates} updates of {batches} "
        f"joint transitions ({epochs_of(found, cells)} epochs), hidden units "
        f"{hidden_widths(cells)}. {chosen}{_missing(list(found.missing))}"
    )


def _count(n: int, what: str) -> str:
    return f"one {what}" if n == 1 else f"{n:,} {what}s"


def _missing(names: Sequence[str]) -> str:
    if not names:
        return "All cells of its plan are done."
    shown = ", ".join(f"`{name}`" for name in names[:MAX_NAMED_CELLS])
    more = f" and {len(names) - MAX_NAMED_CELLS} more" if len(names) > MAX_NAMED_CELLS else ""
    return f"Without results: {shown}{more}."
