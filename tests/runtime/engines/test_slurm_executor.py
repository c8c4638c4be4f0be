"""The executor over submitit, with submitit's own local processes in place of SLURM."""

from pathlib import Path
from typing import Any

import pytest

submitit = pytest.importorskip("submitit", reason="needs submitit")

from swarmdata.errors import BuildError, EngineError  # noqa: E402
from swarmdata.runtime.engines import slurm_executor  # noqa: E402
from swarmdata.runtime.engines.executor_engine import ExecutorEngine  # noqa: E402
from swarmdata.runtime.engines.open_engine import open_engine  # noqa: E402
from swarmdata.runtime.engines.slurm_executor import SlurmExecutor  # noqa: E402
from tests.runtime.engines.conftest import ENTRY, job, starts  # noqa: E402

pytestmark = pytest.mark.slow


class Submitter:
    """Submits to local processes, and knows which of them run."""

    def __init__(self, folder: Path) -> None:
        self.inner = submitit.AutoExecutor(folder=folder, cluster="local")
        self.inner.update_parameters(timeout_min=5)
        self.jobs: list[Any] = []

    def submit(self, *arguments: Any) -> Any:
        self.jobs.append(self.inner.submit(*arguments))
        return self.jobs[-1]

    def queued_jobs(self) -> set[str]:
        return {each.job_id for each in self.jobs if each._process.poll() is None}


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ExecutorEngine:
    monkeypatch.setattr(slurm_executor, "RESULT_SECONDS", 2.0)

    def open_local() -> SlurmExecutor:
        submitter = Submitter(tmp_path / "logs")
        return SlurmExecutor(submitter, submitter.queued_jobs)

    return ExecutorEngine(ENTRY, open_local)


def test_each_job_is_a_job_of_the_cluster(engine: ExecutorEngine, tmp_path: Path) -> None:
    reports: list[int] = []
    with engine:
        engine.run([job(tmp_path, f"job-{k}") for k in range(2)], reports.append)
        with pytest.raises(BuildError, match="picky failed: SpecError"):
            engine.run([job(tmp_path, "picky", "refuse")], reports.append)
    assert sum(reports) == 2 * 7
    assert [starts(tmp_path, f"job-{k}") for k in range(2)] == [1, 1]


def test_a_job_that_dies_is_submitted_again(engine: ExecutorEngine, tmp_path: Path) -> None:
    with engine:
        engine.run([job(tmp_path, "victim", "die once")], lambda n: None)
    assert starts(tmp_path, "victim") == 2


def test_a_machine_without_slurm_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with (
        pytest.raises(EngineError, match="cannot submit to SLURM"),
        open_engine("slurm:debug", "a:b", n_workers=1, folder=tmp_path / "x"),
    ):
        pass
