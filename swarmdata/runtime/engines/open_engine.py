"""Engines by name: `local`, `dask://HOST:PORT`, `slurm[:PARTITION]`, `ray[://HOST:PORT]`."""

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from urllib.parse import parse_qsl

from swarmdata.errors import EngineError
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.engines.cluster_executors import open_dask, open_ray
from swarmdata.runtime.engines.crew import Crew
from swarmdata.runtime.engines.executor_engine import ExecutorEngine
from swarmdata.runtime.engines.jobs import Job, Report, load_handler
from swarmdata.runtime.engines.slurm_executor import open_slurm

LOCAL = "local"

Engine = Crew | ExecutorEngine
"""Does jobs of one kind in several processes; a context manager, which ends them."""

SLURM_MINUTES = 60  # length of a SLURM job, unless the engine's name says another

FORMS = "local, dask://HOST:PORT, slurm[:PARTITION][?minutes=60], ray or ray://HOST:PORT"


def open_engine(
    engine: str | Executor, entry: str, *, n_workers: int, folder: Path, renews: bool = False
) -> Engine:
    """Returns an engine, which begins as a context manager.

    Args:
        engine: its name, or an executor, which stays open.
        entry: "module:function" that returns what does a job.
        n_workers: processes of `local`; the others have their own.
        folder: where `slurm` keeps scripts and logs, `<folder>.slurm`; all nodes see it.
        renews: whether each job gets a new process, of `local`.

    Raises:
        EngineError: the name is none of the known forms.
    """
    if isinstance(engine, Executor):
        return ExecutorEngine(entry, lambda: engine, is_owned=False)
    if engine == LOCAL:
        return Crew(entry, n_workers, renews)
    kind, _, rest = engine.partition(":")
    if kind == "dask" and rest.startswith("//") and len(rest) > len("//"):
        return ExecutorEngine(entry, partial(open_dask, rest[2:]))
    if engine == "ray" or (kind == "ray" and rest.startswith("//")):
        return ExecutorEngine(entry, partial(open_ray, engine if rest else None))
    name, _, options = engine.partition("?")
    kind, _, partition = name.partition(":")
    if kind == "slurm":
        logs = folder.resolve().parent / f"{folder.name}.slurm"
        found = dict(parse_qsl(options, keep_blank_values=True))
        text = found.pop("minutes", str(SLURM_MINUTES))
        if found or not text.isdecimal() or int(text) < 1:
            raise EngineError(f"engine {engine!r} has {options!r}, expected such as ?minutes=60")
        minutes = int(text)
        return ExecutorEngine(entry, partial(open_slurm, partition or None, logs, minutes))
    raise EngineError(f"unknown engine {engine!r}, expected {FORMS}")


def do_jobs(
    jobs: Sequence[Job],
    entry: str,
    what: str,
    *,
    engine: str | Executor = LOCAL,
    workers: int = 1,
    folder: Path,
    report: Report = lambda amount: None,
) -> None:
    """Does all jobs, as a batch: one that fails does not stop the others.

    Args:
        jobs: what to do.
        entry: as `open_engine` takes it.
        what: the jobs in words, such as "evaluations".
        engine: where jobs are done, as `open_engine` takes it.
        workers: processes of the engine `local`; 1: this one, in the order of the jobs.
        folder: what the command writes to.
        report: gets what handlers report.

    Raises:
        SwarmdataError: what the handler of the only job raised, in this process.
        BatchError: jobs failed; the message names them and has the errors.
        EngineError: the engine is unknown, or cannot be reached.
    """
    if not jobs:
        return
    failures = Failures(len(jobs))
    if engine == LOCAL and workers == 1:
        handle = load_handler(entry)
        for job in jobs:
            with failures.item(job.name):
                handle(job.payload, report)
    else:
        n_workers = min(workers, len(jobs))
        with open_engine(engine, entry, n_workers=n_workers, folder=folder) as opened:
            opened.run(jobs, report, lambda job, error: failures.note(job.name, error))
    failures.check(what, "The others are kept: run the same command again to go on.")
