"""What engines cost: seconds until the first job is done, and for 1,000 jobs that do nothing.

    python -m tests.benchmarks.bench_engines [ENGINE ...]

Engines whose packages or daemons are absent are left out, and said. The comparison is the
standard library's process pool without any engine: two processes, the same function.
"""

import importlib.util
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import NamedTuple

from swarmdata.runtime.engines.jobs import Job, do_job
from swarmdata.runtime.engines.open_engine import open_engine
from tests.benchmarks.measuring import table, write_section
from tests.runtime.engines.test_engines import dask_cluster
from tests.support.slurm_loopback import slurm_cluster, why_not

ENTRY = "tests.benchmarks.empty_job:work"
N_WORKERS = 2
N_JOBS = 1_000
N_SLURM_JOBS = 20  # each is a SLURM job with a new interpreter
ROUNDS = 3


class Timing(NamedTuple):
    """Seconds of one round."""

    start: float  # until the first job is done
    jobs: float  # all jobs after the first


class Subject(NamedTuple):
    """An engine to measure."""

    name: str
    open: Callable[[], AbstractContextManager[str | Executor]]  # its cluster, outside the timing
    n_jobs: int = N_JOBS
    package: str | None = None
    what: str = ""


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(N_WORKERS, mp_context=multiprocessing.get_context("spawn"))


@contextmanager
def _slurm() -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder, slurm_cluster(Path(folder) / "slurm"):
        yield "slurm"


SUBJECTS = (
    Subject("local", lambda: nullcontext("local"), what="crew of 2 processes"),
    Subject("executor", _pool, what="`ProcessPoolExecutor` of the user, spawned"),
    Subject("dask", dask_cluster, package="distributed", what="scheduler, 2 workers on loopback"),
    Subject("ray", lambda: nullcontext("ray"), package="ray", what="Ray of this machine"),
    Subject("slurm", _slurm, N_SLURM_JOBS, "submitit", "2 nodes on loopback, a job for each"),
)


def plain(n_jobs: int) -> Timing:
    """The process pool alone: what no engine over processes can beat."""
    start = time.perf_counter()
    with _pool() as pool:
        pool.submit(do_job, ENTRY, {}).result()
        first = time.perf_counter()
        futures = [pool.submit(do_job, ENTRY, {}) for _ in range(n_jobs)]
        for future in futures:
            future.result()
        return Timing(first - start, time.perf_counter() - first)


def measure(engine: str | Executor, n_jobs: int, folder: Path) -> Timing:
    """Opens an engine, does one job, and then the others."""
    start = time.perf_counter()
    done: list[int] = []
    with open_engine(engine, ENTRY, n_workers=N_WORKERS, folder=folder) as opened:
        opened.run([Job("first", {})], done.append)
        first = time.perf_counter()
        opened.run([Job(f"job-{k}", {}) for k in range(n_jobs)], done.append)
        end = time.perf_counter()
    if sum(done) != n_jobs + 1:
        raise AssertionError(f"{sum(done)} of {n_jobs + 1} jobs were done")
    return Timing(first - start, end - first)


def reason_against(subject: Subject) -> str | None:
    """Why a subject cannot be measured here."""
    if subject.package and importlib.util.find_spec(subject.package) is None:
        return f"{subject.package} is not installed"
    return why_not() if subject.name == "slurm" else None


def row(name: str, timings: list[Timing], n_jobs: int, what: str, plain_job: float) -> list[str]:
    """A line of the table; a job's time is the median of the rounds."""
    start = median(each.start for each in timings)
    per_job = median(each.jobs for each in timings) / n_jobs
    return [
        name, what, f"{start:.1f}", str(n_jobs), f"{1000 * per_job:,.2f}",
        f"{1000 * per_job:.2f} ms", f"{per_job / plain_job:.1f}",
    ]  # fmt: skip


def main(names: list[str]) -> None:
    """Measures engines, in turns where they need no cluster of their own, and writes the table."""
    reference = [plain(N_JOBS) for _ in range(ROUNDS)]
    plain_job = median(each.jobs for each in reference) / N_JOBS
    rows = [row("none", reference, N_JOBS, "`ProcessPoolExecutor` alone", plain_job)]
    for subject in SUBJECTS:
        if names and subject.name not in names:
            continue
        if reason := reason_against(subject):
            print(f"{subject.name} is left out: {reason}", file=sys.stderr)
            continue
        timings = []
        for _ in range(ROUNDS):
            with subject.open() as engine, tempfile.TemporaryDirectory() as folder:
                timings.append(measure(engine, subject.n_jobs, Path(folder) / "jobs"))
        rows.append(row(subject.name, timings, subject.n_jobs, subject.what, plain_job))
        print(rows[-1], file=sys.stderr)
    head = ("engine", "what", "first job, s", "jobs", "1,000 jobs, s", "a job", "ratio to none")
    body = table(head, [tuple(each) for each in rows])
    print(body)
    if len(rows) > len(SUBJECTS):
        write_section("Engines", f"{_words()}\n\n{body}")
    else:
        print("docs/measurements.md stays: not all engines were measured", file=sys.stderr)


def _words() -> str:
    packages = [s.package for s in SUBJECTS if s.package and not reason_against(s)]
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    return (
        f"Jobs that do nothing, {N_WORKERS} processes, medians of {ROUNDS} rounds "
        f"(`python -m tests.benchmarks.bench_engines`; {versions}). The first job's time has the "
        "start of processes, or the connection to a cluster that runs already. `none` is the "
        "standard library's process pool without an engine: a message through a pipe to a process "
        f"and back. SLURM was timed over {N_SLURM_JOBS} jobs, from which 1,000 is computed: each "
        "starts an interpreter. Parts and cells take seconds to hours, so only SLURM's figure "
        "matters, where parts are small."
    )


if __name__ == "__main__":
    main(sys.argv[1:])
