"""Does the jobs of a command: in this process, in several of this machine, or by another engine."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from swarmdata.runtime.batches import Failures
from swarmdata.runtime.engines.jobs import Job, Report, load_handler
from swarmdata.runtime.engines.open_engine import LOCAL, open_engine


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
        entry: "module:function" that returns the handler.
        what: the jobs in words, such as "evaluations".
        engine: as `open_engine` takes it.
        workers: processes of the engine `local`; 1: this one, in the order of the jobs.
        folder: what the command writes to, as `open_engine` takes it.
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
