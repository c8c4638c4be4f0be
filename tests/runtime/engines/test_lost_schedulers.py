"""Schedulers that are lost while jobs run: found again if they can be, else one clear sentence."""

import importlib.util
import os
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import EngineError
from swarmdata.runtime.engines.executor_engine import ExecutorEngine
from swarmdata.runtime.engines.open_engine import open_engine
from tests.runtime.engines.test_engines import (
    HANDLER,
    START_SECONDS,
    free_port,
    job,
    start_dask,
    starts,
)

N_JOBS = 4


@pytest.fixture(autouse=True)
def handler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "engine_handler.py").write_text(HANDLER)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path.cwd())]))


def begun(folder: Path) -> int:
    """How many jobs have begun."""
    return len(list(folder.glob("job-*")))


def when_a_job_has_begun(folder: Path, action: object) -> threading.Thread:
    assert callable(action)

    def watch() -> None:
        while not begun(folder):
            time.sleep(0.05)
        action()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    return thread


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
    engine = open_engine(
        f"dask://{address}", "engine_handler:work", n_workers=2, folder=tmp_path / "x"
    )
    try:
        with engine as opened:
            lost = when_a_job_has_begun(tmp_path, lose)
            opened.run(jobs, reports.append)
            lost.join(START_SECONDS)
    finally:
        for daemon in daemons:
            daemon.terminate()
            daemon.wait(START_SECONDS)
    assert sum(reports) == N_JOBS * 7
    assert sum(starts(tmp_path, each.name) for each in jobs) > N_JOBS, "some were begun again"


class Broken(Executor):
    """An executor whose connection is lost after some jobs."""

    def __init__(self, n_jobs: int) -> None:
        self.n_left = n_jobs

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        if not self.n_left:
            raise ConnectionError("the scheduler is gone")
        self.n_left -= 1
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_a_connection_that_is_lost_is_made_again(tmp_path: Path) -> None:
    opened: list[Broken] = []

    def connect() -> Broken:
        opened.append(Broken(3))
        return opened[-1]

    reports: list[int] = []
    with ExecutorEngine("engine_handler:work", connect) as engine:
        engine.run([job(tmp_path, f"job-{k}") for k in range(N_JOBS)], reports.append)
    assert sum(reports) == N_JOBS * 7
    assert len(opened) == 2


def test_a_scheduler_that_stays_away_is_one_sentence(tmp_path: Path) -> None:
    opened: list[Broken] = []

    def connect() -> Broken:
        if opened:
            raise EngineError("no scheduler answers")
        opened.append(Broken(1))
        return opened[-1]

    with (
        ExecutorEngine("engine_handler:work", connect) as engine,
        pytest.raises(EngineError, match="no scheduler answers"),
    ):
        engine.run([job(tmp_path, f"job-{k}") for k in range(N_JOBS)], lambda n: None)
