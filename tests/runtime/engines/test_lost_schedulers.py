"""Schedulers that are lost while jobs run: found again if they can be, else one clear sentence."""

import importlib.util
import subprocess
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any
from unittest.mock import Mock, call

import pytest

from swarmdata.errors import BuildError, EngineError
from swarmdata.runtime.engines import cluster_executors, slurm_executor
from swarmdata.runtime.engines.executor_engine import ExecutorEngine
from swarmdata.runtime.engines.open_engine import open_engine
from swarmdata.runtime.engines.slurm_executor import SlurmExecutor
from tests.runtime.engines.conftest import ENTRY, job, once_there, starts, wait_for
from tests.runtime.engines.test_engines import START_SECONDS, free_port, start_dask

N_JOBS = 4


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs distributed")
def test_a_dask_scheduler_that_starts_again_gets_the_jobs_again(tmp_path: Path) -> None:
    address = f"127.0.0.1:{free_port()}"

    def start() -> "list[subprocess.Popen[bytes]]":
        workers = (f"tcp://{address}", "--nworkers", "2", "--nthreads", "1")
        return [
            start_dask("dask_scheduler", "--host", address),
            start_dask("dask_worker", *workers),
        ]

    daemons = start()

    def lose() -> None:
        daemons[0].kill()
        daemons[0].wait()
        daemons[1].terminate()  # workers end with their scheduler
        daemons[1].wait(START_SECONDS)
        daemons.extend(start())

    jobs = [job(tmp_path, f"job-{k}", "wait") for k in range(N_JOBS)]
    reports: list[int] = []
    engine = open_engine(f"dask://{address}", ENTRY, n_workers=2, folder=tmp_path / "x")
    try:
        with engine as opened:
            lost = once_there(tmp_path, "job-*", lose)
            opened.run(jobs, reports.append)
            lost.join(START_SECONDS)
    finally:
        for daemon in daemons:
            daemon.terminate()
            daemon.wait(START_SECONDS)
    assert sum(reports) == N_JOBS * 7
    assert sum(starts(tmp_path, each.name) for each in jobs) > N_JOBS, "some were begun again"


GONE = Exception("Ray Client is not connected.")
"""Dask's, submitit's and the system's errors have classes of their own; Ray's have none."""


class Broken(Executor):
    """An executor whose connection is lost after some jobs."""

    def __init__(self, n_jobs: int, error: Exception) -> None:
        self.n_left, self.error = n_jobs, error

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        if not self.n_left:
            raise self.error
        self.n_left -= 1
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


@pytest.mark.parametrize("is_owned", [True, False], ids=["ours", "the user's"])
def test_an_executor_that_takes_no_more_jobs_is_one_sentence(
    is_owned: bool, tmp_path: Path
) -> None:
    executor = Broken(0, GONE)
    with (
        ExecutorEngine(ENTRY, lambda: executor, is_owned) as engine,
        pytest.raises(EngineError, match=r"takes no more jobs .* is finished is kept") as raised,
    ):
        engine.run([job(tmp_path, "any")], lambda n: None)
    assert raised.value.__cause__ is GONE


def test_a_scheduler_that_stays_away_is_one_sentence(tmp_path: Path) -> None:
    opened: list[Broken] = []

    def connect() -> Broken:
        if opened:
            raise EngineError("no scheduler answers")
        opened.append(Broken(1, ConnectionError("the scheduler is gone")))
        return opened[-1]

    with (
        ExecutorEngine(ENTRY, connect) as engine,
        pytest.raises(EngineError, match="no scheduler answers"),
    ):
        engine.run([job(tmp_path, f"job-{k}") for k in range(N_JOBS)], lambda n: None)


class Deaf(Broken):
    """An executor that never settles the future of its first job."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future = super().submit(fn, *args, **kwargs)
        return future if self.n_left else Future()


@pytest.mark.parametrize("first", [Broken(3, GONE), Deaf(1, GONE)], ids=["broken", "deaf"])
def test_a_connection_that_is_lost_is_made_again(first: Broken, tmp_path: Path) -> None:
    """What a deaf executor took is submitted once more."""
    opened: list[Broken] = []

    def connect() -> Broken:
        opened.append(Broken(9, GONE) if opened else first)
        return opened[-1]

    reports: list[int] = []
    with ExecutorEngine(ENTRY, connect) as engine:
        engine.run([job(tmp_path, f"job-{k}") for k in range(N_JOBS)], reports.append)
    assert sum(reports) == N_JOBS * 7
    assert len(opened) == 2


def test_a_job_that_loses_every_executor_is_named(tmp_path: Path) -> None:
    with (
        ExecutorEngine(ENTRY, lambda: Deaf(1, OSError("gone"))) as engine,
        pytest.raises(BuildError, match=r"failed: it was lost 3 times, last by OSError: gone"),
    ):
        engine.run([job(tmp_path, f"job-{k}") for k in range(N_JOBS)], lambda n: None)


def test_a_dask_client_without_its_scheduler_gets_no_calls() -> None:
    """It takes them although its connection is lost."""
    client = Mock(status="running")
    executor = cluster_executors.DaskExecutor(client)
    executor.submit(print)
    client.status = "connecting"
    with pytest.raises(ConnectionError, match="client of Dask is connecting"):
        executor.submit(print)
    executor.shutdown(wait=False)
    settings = call.get_executor(pure=False, retries=0)
    assert client.mock_calls == [settings, call.get_executor().submit(print), call.close()]


def slurm_job(error: Exception | None = None, *, is_done: bool = True) -> Mock:
    """A job of submitit, whose files and commands may fail; it submits itself."""
    job = Mock(job_id="7")
    job.paths.stderr = "7_log.err"
    job.paths.result_pickle.exists.configure_mock(return_value=is_done, side_effect=error)
    job.result.return_value, job.cancel.side_effect, job.submit.return_value = 3, error, job
    return job


CANCELLED = [call(check=False)]


def test_slurm_jobs_of_which_nothing_is_known_are_lost_and_the_others_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(slurm_executor, "POLL_SECONDS", 0.01)
    bad, good = slurm_job(OSError("stale file handle")), slurm_job()
    executor = SlurmExecutor(bad, lambda: {"7"})
    lost = executor.submit(print)
    assert isinstance(lost.exception(START_SECONDS), OSError)
    executor._submitter = good
    assert executor.submit(print).result(START_SECONDS) == 3, "the thread still looks"
    executor.shutdown()


def test_slurm_jobs_are_waited_for_while_it_does_not_answer_and_cancelled_with_their_futures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(slurm_executor, "POLL_SECONDS", 0.01)
    monkeypatch.setattr(slurm_executor, "RESULT_SECONDS", 0.0)
    answer: set[str] | None = None
    looks: list[object] = []

    def queued_jobs() -> set[str] | None:
        looks.append(answer)
        return answer

    waiting = slurm_job(is_done=False)
    executor = SlurmExecutor(waiting, queued_jobs)
    future, unwanted = executor.submit(print), executor.submit(print)
    wait_for(lambda: len(looks) > 3)
    assert not future.done()
    assert unwanted.cancel()
    wait_for(lambda: waiting.cancel.mock_calls == CANCELLED)
    answer = set()
    with pytest.raises(EngineError, match="SLURM job 7 ended without a result; its log is 7_log"):
        future.result(START_SECONDS)
    executor.shutdown()


def test_slurm_that_is_gone_does_not_answer(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert slurm_executor.queued_jobs() is None
    gone = [slurm_job(FileNotFoundError("scancel")) for _ in range(2)]
    monkeypatch.setattr(SlurmExecutor, "_poll", lambda self: None)
    executor = SlurmExecutor(gone[0], slurm_executor.queued_jobs)
    executor.submit(print)
    executor._submitter = gone[1]
    executor.submit(print)
    executor.shutdown()
    assert [each.cancel.mock_calls for each in gone] == [CANCELLED, CANCELLED], "all are tried"
