"""What engines cost: seconds until the first job is done, and for 1,000 jobs that do nothing.

    python -m tests.benchmarks.bench_engines [ENGINE ...] [--rounds N]

Engines whose packages or daemons are absent are left out, and said. The comparison is the
standard library's process pool without any engine: two processes, the same function.
"""

import argparse
import importlib.util
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import NamedTuple

from swarmdata.runtime.engines.jobs import Job, do_job
from swarmdata.runtime.engines.open_engine import open_engine
from tests.benchmarks.measuring import table, write_section
from tests.runtime.engines.test_engines import dask_cluster, ray_cluster
from tests.support.slurm_loopback import slurm_cluster, why_not

ENTRY = "tests.benchmarks.empty_job:work"
N_WORKERS = 2
N_JOBS = 1_000
N_SLURM_JOBS = 20  # each is a SLURM job with a new interpreter


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


NONE = Subject("none", _pool, what="`ProcessPoolExecutor` alone")
"""What no engine over processes can beat."""

SUBJECTS = (
    Subject("local", lambda: nullcontext("local"), what="crew of 2 processes"),
    Subject("executor", _pool, what="`ProcessPoolExecutor` of the user, spawned"),
    Subject("dask", dask_cluster, package="distributed", what="scheduler, 2 workers on loopback"),
    Subject("ray", lambda: nullcontext("ray"), package="ray", what="processes of this machine"),
    Subject("ray-client", ray_cluster, package="ray", what="`ray://`, 2 cores on loopback"),
    Subject("slurm", _slurm, N_SLURM_JOBS, "submitit", "2 nodes on loopback, a job for each"),
)


def plain(n_jobs: int) -> Timing:
    """The process pool alone."""
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


def row(subject: Subject, timings: list[Timing], plain_job: float) -> tuple[str, ...]:
    """A line of the table; a job's time is the median of the rounds."""
    start = median(each.start for each in timings)
    per_job = median(each.jobs for each in timings) / subject.n_jobs
    return (
        f"`{subject.name}`", subject.what, f"{start:.1f}", str(subject.n_jobs),
        f"{1000 * per_job:,.2f}", f"{per_job / plain_job:.1f}",
    )  # fmt: skip


def take_turns(subjects: Sequence[Subject], rounds: int) -> dict[str, list[Timing]]:
    """Measures the pool alone and every engine once in each round, so that load meets all."""
    timings: dict[str, list[Timing]] = {}
    for turn in range(rounds):
        timings.setdefault(NONE.name, []).append(plain(NONE.n_jobs))
        for subject in subjects:
            with subject.open() as engine, tempfile.TemporaryDirectory() as folder:
                found = measure(engine, subject.n_jobs, Path(folder) / "jobs")
            timings.setdefault(subject.name, []).append(found)
            print(f"round {turn + 1}: {subject.name} {found}", file=sys.stderr, flush=True)
    return timings


def text(subjects: Sequence[Subject], timings: dict[str, list[Timing]]) -> str:
    """The section: words, then a line for each engine."""
    plain_job = median(each.jobs for each in timings[NONE.name]) / NONE.n_jobs
    head = ("engine", "what", "first job, s", "jobs", "1,000 jobs, s", "ratio to none")
    rows = [row(each, timings[each.name], plain_job) for each in (NONE, *subjects)]
    packages = sorted({each.package for each in subjects if each.package})
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    rounds, load = len(timings[NONE.name]), os.getloadavg()[1] / (os.cpu_count() or 1)
    busy = (
        f"**The machine was busy with other work**, {load:.0f} processes for each core, so that "
        "seconds are longer than on a quiet one; compare the ratios.\n\n"
    )
    return (
        f"The overhead of [engines](studies.md#engines): empty jobs, {N_WORKERS} processes, "
        f"medians of {rounds} rounds (`python -m tests.benchmarks.bench_engines`; {versions}). The "
        "first job includes the start of processes or the connection to a running cluster. `none` "
        "is the standard library's process pool without an engine. SLURM, which starts an "
        f"interpreter per job, was extrapolated from {N_SLURM_JOBS} jobs; since real jobs take "
        "seconds to hours, only its overhead can matter.\n\n"
        f"{busy if load > 1.5 else ''}{table(head, rows)}"
    )


def main() -> None:
    """Measures engines, and writes the section if all could be measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("engines", nargs="*", metavar="ENGINE", help="default: all")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    known = [each.name for each in SUBJECTS]
    if unknown := {*arguments.engines} - {*known}:
        parser.error(f"unknown engines {', '.join(unknown)}, expected {', '.join(known)}")
    subjects = []
    for subject in SUBJECTS:
        if arguments.engines and subject.name not in arguments.engines:
            continue
        if reason := reason_against(subject):
            print(f"{subject.name} is left out: {reason}", file=sys.stderr)
            continue
        subjects.append(subject)
    body = text(subjects, take_turns(subjects, arguments.rounds))
    print(body)
    if len(subjects) == len(SUBJECTS):
        write_section("Engines", body)
    else:
        print("docs/measurements.md stays: not all engines were measured", file=sys.stderr)


if __name__ == "__main__":
    main()
