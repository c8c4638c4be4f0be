"""A study of seconds on a tiny dataset, done in the test's own process."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")

from swarmdata.errors import BuildError
from swarmdata.evaluation.study.cells import run_cells
from swarmdata.evaluation.study.cells.cell_worker import run_job
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions
from swarmdata.runtime.engines.jobs import Job, OnFailure, Report
from tests.support.drawn import save_empty_figures

BC = {"algorithm": "bc", "family": "cloning", "updates": 20}
MADDPG = {"algorithm": "maddpg_bc", "family": "actor-critic", "updates": 10,
          "settings": {"bc_warmup_share": 0.4}}  # fmt: skip

Make = Callable[..., Study]


class Here(nullcontext["Here"]):
    """A crew of this process."""

    def __init__(
        self, engine: object, entry: str, *, n_workers: int, folder: Path, renews: bool
    ) -> None:
        assert (entry, renews) == (run_cells.WORKER, True)
        super().__init__(self)

    def run(self, jobs: Sequence[Job], progress: Report, on_failure: OnFailure) -> None:
        for job in jobs:
            try:
                run_job(job.payload, progress)
            except BuildError as error:
                on_failure(job, BuildError(f"{job.name} failed: {error}"))


def work_here(patch: pytest.MonkeyPatch) -> None:
    """Cells are done in this process, and figures are empty files."""
    patch.setattr(run_cells, "open_engine", Here)
    save_empty_figures(patch)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    work_here(monkeypatch)


def options_in(folder: Path, **changes: Any) -> StudyOptions:
    """A study in folders `out` and `work`."""
    return StudyOptions(folder / "out", folder / "work", workers=1, progress=False, **changes)


@pytest.fixture
def options(tmp_path: Path) -> StudyOptions:
    """A study in the test's folder."""
    return options_in(tmp_path)


def rows_below(page: str, title: str, first: str) -> dict[str, list[str]]:
    """Cells of the rows of the table that begins with a cell, below a title, by their first."""
    table = page.partition(f"## {title}")[2].partition(f"\n| {first}")[2].partition("\n\n")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[1:]]
    return {row[0]: row[1:] for row in rows}


@pytest.fixture(scope="session")
def make_study(data: Path) -> Make:
    """A study of the tiny dataset; arguments replace its fields."""

    def make(**changes: Any) -> Study:
        content: dict[str, Any] = {
            "name": "tiny",
            "datasets": [str(data)],
            "algorithms": {"bc": BC, "other": {**BC, "settings": {"output": "clip"}}},
            "seeds": [0, 1],
            "hidden": [8],
            "episodes": 4,
        }
        return Study.parse({**content, **changes}, "the test's study")

    return make
