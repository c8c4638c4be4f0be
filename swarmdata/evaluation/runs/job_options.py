"""Where the jobs of a command are done, and the bar that shows them."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TypedDict, Unpack

from tqdm import tqdm

from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import LOCAL, do_jobs


class JobOptions(TypedDict, total=False):
    """No option changes the results of jobs."""

    engine: str | Executor  # as `build` takes it; all processes see the folders that jobs name
    workers: int  # processes of the engine `local`; 1, the default: this one
    progress: bool  # whether to show a bar (on standard error, if that is a terminal)


def do_with_bar(
    jobs: Sequence[Job],
    entry: str,
    what: str,
    folder: Path,
    *,
    total: int,
    unit: str = "it",
    **options: Unpack[JobOptions],
) -> None:
    """Does all jobs, as `do_jobs` does, below a bar of what they report: a total, in a unit."""
    hidden = None if jobs and options.get("progress", True) else True  # None: if no terminal
    with tqdm(total=total, desc=what, unit=unit, unit_scale=True, disable=hidden) as bar:

        def report(amount: int) -> None:
            bar.update(amount)

        do_jobs(
            jobs, entry, what, engine=options.get("engine", LOCAL),
            workers=options.get("workers", 1), folder=folder, report=report,
        )  # fmt: skip
