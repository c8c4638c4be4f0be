"""What every engine does: jobs once, errors, lost jobs, and the same datasets."""

import importlib.util
import multiprocessing
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path

import pytest

from swarmdata.building.build import build
from swarmdata.errors import BuildError, EngineError
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import open_engine
from swarmdata.store import read_manifest
from tests.runtime.engines.conftest import ENTRY, job, starts, wait_for
from tests.support.pairs import slow
from tests.support.tiny import TINY

KERNEL = """
import time
from numba.extending import overload
from swarmdata.runtime.kernels import kernel

def twice(x): ...

@overload(twice)
def compile_twice(x):
    time.sleep(2.0)  # as long as two processes that start together need to meet here
    return lambda x: 2.0 * x

@kernel
def double(x: float) -> float:
    return twice(x)
"""

START_SECONDS = 120
"""For schedulers and their workers, on a busy machine."""

os.environ.setdefault("RAY_agent_register_timeout_ms", str(1000 * START_SECONDS))


def start_dask(command: str, *arguments: str) -> "subprocess.Popen[bytes]":
    program = [sys.executable, "-m", f"distributed.cli.{command}", *arguments, "--no-dashboard"]
    return subprocess.Popen(program, stderr=subprocess.DEVNULL)


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def dask_cluster() -> Iterator[str]:
    """A scheduler and two workers, which are started again when they are killed."""
    address = f"127.0.0.1:{free_port()}"
    scheduler = start_dask("dask_scheduler", "--host", address)
    worker = start_dask("dask_worker", f"tcp://{address}", "--nworkers", "2", "--nthreads", "1")
    try:
        yield f"dask://{address}"
    finally:
        for process in (worker, scheduler):
            process.terminate()
            process.wait(START_SECONDS)


@contextmanager
def pool() -> Iterator[Executor]:
    """Processes of this machine, as a user's own executor."""
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        yield executor


@contextmanager
def ray_cluster() -> Iterator[str]:
    """A Ray of two cores that runs already, reached as a client reaches one elsewhere."""
    port, client_port = free_port(), free_port()
    program = [
        sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block",
        "--num-cpus=2", "--node-ip-address=127.0.0.1", f"--port={port}",
        f"--ray-client-server-port={client_port}", "--include-dashboard=false",
        "--disable-usage-stats",
    ]  # fmt: skip
    head = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: head.poll() is not None or answers(client_port))
        yield f"ray://127.0.0.1:{client_port}"
    finally:
        head.terminate()
        head.wait(START_SECONDS)


def answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False


STARTS: dict[str, tuple[Callable[[], AbstractContextManager[str | Executor]], str | None]] = {
    "local": (lambda: nullcontext("local"), None),
    "executor": (pool, None),
    "dask": (dask_cluster, "distributed"),
    "ray": (lambda: nullcontext("ray"), "ray"),
    "ray-client": (ray_cluster, "ray"),
}
"""How each engine is started, and the package that it needs."""

ENGINES = ["local", "executor", *slow("dask", "ray", "ray-client")]

WITH_SLOW_EXECUTOR = ["local", *slow("executor", "dask", "ray", "ray-client")]
"""Where its processes do what those of `local` do, after the same beginning."""


@pytest.fixture
def empty_kernel_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """For the processes of engines that are opened after this one."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    return tmp_path / "kernels"


@pytest.fixture(params=ENGINES)
def engine(
    request: pytest.FixtureRequest, tmp_path: Path, handler: None
) -> Iterator[str | Executor]:
    """Each engine; its processes find the handler and a kernel."""
    start, package = STARTS[request.param]
    if package is not None and importlib.util.find_spec(package) is None:
        pytest.skip(f"needs {package}")
    (tmp_path / "engine_kernel.py").write_text(KERNEL)
    with start() as found:
        yield found


def test_jobs_are_done_once_and_progress_adds_up(engine: str | Executor, tmp_path: Path) -> None:
    reports: list[int] = []
    with open_engine(engine, ENTRY, n_workers=2, folder=tmp_path / "x") as opened:
        opened.run([job(tmp_path, f"job-{k}") for k in range(5)], reports.append)
        opened.run([job(tmp_path, "later")], reports.append)
    assert sum(reports) == 6 * 7
    started = [(tmp_path / f"job-{k}").read_text().split() for k in range(5)]
    assert [len(each) for each in started] == [2] * 5
    if engine == "local":
        assert len({worker for worker, _ in started}) <= 2
        assert all(threads == "1" for _, threads in started), "BLAS must use one thread"


def test_an_error_stops_everything_or_is_handed_over(
    engine: str | Executor, tmp_path: Path
) -> None:
    failed: list[tuple[str, str]] = []
    jobs = [job(tmp_path, "picky", "refuse"), job(tmp_path, "good")]
    with open_engine(engine, ENTRY, n_workers=2, folder=tmp_path / "x") as opened:
        opened.run(jobs, lambda n: None, lambda each, why: failed.append((each.name, str(why))))
        with pytest.raises(BuildError, match="picky failed: SpecError: this cannot be done"):
            opened.run(jobs[:1], lambda n: None)
    assert failed == [("picky", "picky failed: SpecError: this cannot be done")]
    assert starts(tmp_path, "picky") == 2  # not tried again in a run
    assert starts(tmp_path, "good") == 1


def test_a_job_whose_process_dies_is_done_again_and_named_in_the_end(
    engine: str | Executor, tmp_path: Path
) -> None:
    if isinstance(engine, Executor):
        pytest.skip("a pool of the user's is broken then: see test_lost_schedulers.py")
    reports: list[int] = []
    with open_engine(engine, ENTRY, n_workers=2, folder=tmp_path / "x") as opened:
        opened.run([job(tmp_path, "victim", "die once"), job(tmp_path, "good")], reports.append)
        assert starts(tmp_path, "good") == 1
        assert starts(tmp_path, "victim") == 2
        assert sum(reports) == 2 * 7
        with pytest.raises(BuildError, match=r"doomed failed.*3 times"):
            opened.run([job(tmp_path, "doomed", "die")], reports.append)


@pytest.mark.parametrize(
    "name", ["dask", "dask://", "dask:host", "rays", "slurm:debug?hours=2", "slurm?minutes=0", ""]
)
def test_other_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(EngineError, match=r"expected (local, dask|such as \?minutes)"):
        open_engine(name, "a:b", n_workers=1, folder=tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("engine", WITH_SLOW_EXECUTOR, indirect=True)
def test_processes_of_a_node_compile_a_kernel_once(
    empty_kernel_cache: Path, engine: str | Executor, tmp_path: Path
) -> None:
    names = [f"kernel-{k}" for k in range(4)]
    jobs = [job(tmp_path, name, "compile") for name in names]
    with open_engine(engine, ENTRY, n_workers=2, folder=tmp_path / "x") as opened:
        opened.run(jobs, lambda n: None)
    assert max(int((tmp_path / name).read_text()) for name in names) == 1
    index = list(empty_kernel_cache.rglob("*.nbi"))
    code = list(empty_kernel_cache.rglob("*.nbc"))
    assert (len(index), len(code)) == (1, 1)


def test_ctrl_c_cancels_what_has_not_begun(engine: str | Executor, tmp_path: Path) -> None:
    def stop(each: Job, error: BuildError) -> None:
        raise KeyboardInterrupt

    names = [f"job-{k}" for k in range(20)]
    jobs = [job(tmp_path, "picky", "refuse"), *[job(tmp_path, name, "pause") for name in names]]
    opened = open_engine(engine, ENTRY, n_workers=2, folder=tmp_path / "x")
    with pytest.raises(KeyboardInterrupt), opened:
        opened.run(jobs, lambda n: None, stop)
    assert len(list(tmp_path.glob("job-*"))) < len(names)
    if isinstance(engine, str):
        return
    assert engine.submit(os.getpid).result() > 0, "the user's executor stays open"


@pytest.mark.slow
@pytest.mark.parametrize("engine", WITH_SLOW_EXECUTOR, indirect=True)
def test_a_dataset_is_the_same_from_every_engine(
    engine: str | Executor, tmp_path: Path, tiny: Path
) -> None:
    out = build(TINY, tmp_path / "d", engine=engine, workers=2, progress=False)
    assert read_manifest(out).digest == read_manifest(tiny).digest


def study_tables(engine: str | Executor, data: Path, folder: Path) -> dict[str, bytes]:
    """Runs a study of two cells by an engine; returns its tables, but for those of costs."""
    from swarmdata.evaluation.study.plan import Study
    from swarmdata.evaluation.study.run_study import StudyOptions, run_study

    build(TINY, data, workers=1, progress=False)
    cell = {"algorithm": "bc", "family": "cloning", "updates": 4}
    plan = {
        "name": "tiny",
        "datasets": [str(data)],
        "algorithms": {"bc": cell, "other": {**cell, "settings": {"output": "clip"}}},
        "seeds": [0, 1],
        "hidden": [8],
        "episodes": 4,
        "tasks": {
            "datasets": [str(data)], "algorithms": ["bc"], "tasks": ["coop_nav-easy"],
            "episodes": 3,
        },
        "sweeps": {
            "noise": {"dataset": str(data), "vary": "observation", "axis": "noise=0,0.2",
                      "points": 2, "episodes": 2},
        },
    }  # fmt: skip
    options = StudyOptions(folder / "out", folder / "work", 2, engine, progress=False)
    failures, _ = run_study(Study.parse(plan, "the test's study"), options, "the command")
    assert failures == {}
    out = folder / "out"
    tables = {str(file.relative_to(out)): file for file in sorted(out.rglob("*.csv"))}
    assert {"results.csv", "tasks.csv", "sweeps/noise/sweep.csv"} <= tables.keys()
    return {name: file.read_bytes() for name, file in tables.items() if "cost" not in name}


@pytest.mark.slow
def test_a_study_has_the_same_tables_from_every_engine(
    engine: str | Executor, tmp_path: Path
) -> None:
    pytest.importorskip("torch", reason="cells are trained")
    pytest.importorskip("matplotlib", reason="a study has figures")
    data = tmp_path / TINY.id
    there = study_tables(engine, data, tmp_path / "there")
    assert there == study_tables("local", data, tmp_path / "here")
