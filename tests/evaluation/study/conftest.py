"""A study of seconds on a tiny dataset, done in the test's own process."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")

from swarmdata.errors import BuildError
from swarmdata.evaluation.study.cells import run_cells
from swarmdata.evaluation.study.cells.cell_worker import run_job
from swarmdata.evaluation.study.plan import Study
from swarmdata.runtime.engines.jobs import Job, OnFailure, Report
from tests.support.tiny import make_tiny

BC = {"algorithm": "bc", "family": "cloning", "updates": 20}
MADDPG = {
    "algorithm": "maddpg_bc",
    "family": "actor-critic",
    "updates": 10,
    "settings": {"bc_warmup_share": 0.4},
}


class Here:
    """A crew of this process."""

    def __init__(
        self, engine: object, entry: str, *, n_workers: int, folder: Path, renews: bool
    ) -> None:
        assert (entry, renews) == (run_cells.WORKER, True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...

    def run(self, jobs: Sequence[Job], progress: Report, on_failure: OnFailure) -> None:
        for job in jobs:
            try:
                run_job(job.payload, progress)
            except BuildError as error:
                on_failure(job, BuildError(f"{job.name} failed: {error}"))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells are done in this process."""
    monkeypatch.setattr(run_cells, "open_engine", Here)


@pytest.fixture(scope="session")
def data(tiny: Path) -> Path:
    """Folder of a tiny dataset."""
    return tiny


@pytest.fixture(scope="session")
def other_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of another tiny dataset of the same task."""
    folder = tmp_path_factory.mktemp("other") / "coop_nav-other-v0"
    return make_tiny(folder, id="coop_nav-other-v0", seed=6)


@pytest.fixture(scope="session")
def make_study(data: Path) -> Callable[..., Study]:
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
