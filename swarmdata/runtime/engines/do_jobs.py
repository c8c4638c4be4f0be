"""Does the jobs of a command: in this process, in several of this machine, or by another engine."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from swarmdata.runtime.engines.jobs import Job, OnFailure, Report, load_handler, stop_at_failure
from swarmdata.runtime.engines.open_engine import LOCAL, open_engine


def do_jobs(
    jobs: Sequence[Job],
    entry: str,
    *,
    engine: str | Executor = LOCAL,
    workers: int = 1,
    folder: Path,
    report: Report = lambda amount: None,
    on_failure: OnFailure = stop_at_failure,
) -> None:
    """Does all jobs; what is done stays done.

    Args:
        jobs: what to do.
        entry: "module:function" that returns the handler.
        engine: as `open_engine` takes it.
        workers: processes of the engine `local`; 1: this one, in the order of the jobs.
        folder: what the command writes to, as `open_engine` takes it.
        report: gets what handlers report.
        on_failure: gets a job that failed in another process, and why; by default, the first ends
            the run. An error in this process is always raised as it is.

    Raises:
        SwarmdataError: in this process, what the handler raised.
        BuildError: elsewhere, a job failed, by default; the message names it and has the error.
        EngineError: the engine is unknown, or cannot be reached.
    """
    if not jobs:
        return
    if engine == LOCAL and workers == 1:
        handle = load_handler(entry)
        for job in jobs:
            handle(job.payload, report)
        return
    n_workers = min(workers, len(jobs))
    with open_engine(engine, entry, n_workers=n_workers, folder=folder) as opened:
        opened.run(jobs, report, on_failure)
