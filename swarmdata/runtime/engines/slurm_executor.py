"""The executor of a SLURM cluster, by submitit: a SLURM job for each job.

A job is done when its result is in submitit's folder. Whether it was lost is asked of `squeue`:
submitit asks `sacct`, every ten minutes, and clusters without accounting have none.
"""

import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmdata.errors import EngineError
from swarmdata.runtime.engines.jobs import THREAD_VARIABLES
from swarmdata.runtime.extras import require_extra

POLL_SECONDS = 1.0  # between two looks at the jobs

RESULT_SECONDS = 20.0
"""After a job has left the queue, how long its result may take to appear on the file system."""

QueuedJobs = Callable[[], set[str] | None]
"""Returns the ids of jobs that wait or run, None if the scheduler does not answer now."""


@dataclass
class _Waiting:
    """A job that has no result yet."""

    job: Any  # of submitit
    left_at: float | None = None  # when it was first seen to have left the queue, s


class SlurmExecutor(Executor):
    """Submits to SLURM; a thread looks for finished and lost jobs and settles their futures."""

    def __init__(self, submitter: Any, queued_jobs: QueuedJobs) -> None:
        self._submitter, self._queued_jobs = submitter, queued_jobs
        self._waiting: dict[Future[Any], _Waiting] = {}
        self._lock = threading.Lock()
        self._is_open = True
        self._poller = threading.Thread(target=self._poll, daemon=True)
        self._poller.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Calls a function in a SLURM job of its own.

        Raises:
            EngineError: SLURM does not take the job.
        """
        future: Future[Any] = Future()
        try:
            job = self._submitter.submit(fn, *args, **kwargs)
        except Exception as error:  # submitit passes on what sbatch printed
            raise EngineError(
                f"SLURM does not take the job: {error}. What is finished is kept: run the same "
                "command again when `sinfo` answers."
            ) from error
        with self._lock:
            self._waiting[future] = _Waiting(job)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancels the SLURM jobs that nobody waits for any more."""
        self._is_open = False
        with self._lock:
            abandoned, self._waiting = self._waiting, {}
        for each in abandoned.values():
            _cancel(each.job)

    def _poll(self) -> None:
        while self._is_open:
            with self._lock:
                waiting = dict(self._waiting)
            queued = self._queued_jobs() if waiting else None
            for future, each in waiting.items():
                if self._settle(future, each, queued):
                    with self._lock:
                        self._waiting.pop(future, None)
            time.sleep(POLL_SECONDS)

    def _settle(self, future: "Future[Any]", each: _Waiting, queued: set[str] | None) -> bool:
        """Cancels, finishes or fails a future; says whether there is no more to wait for."""
        if future.cancelled():
            _cancel(each.job)
            return True
        try:
            if each.job.paths.result_pickle.exists():
                future.set_result(each.job.result())
                return True
        except Exception as error:  # of submitit, which ended the job, or of the file system
            future.set_exception(error)
            return True
        if queued is None or str(each.job.job_id) in queued:
            each.left_at = None
            return False
        each.left_at = each.left_at or time.monotonic()
        if time.monotonic() - each.left_at < RESULT_SECONDS:
            return False
        future.set_exception(
            EngineError(
                f"the SLURM job {each.job.job_id} ended without a result; its log is "
                f"{each.job.paths.stderr}"
            )
        )
        return True


def _cancel(job: Any) -> None:
    """Cancels a SLURM job, if SLURM answers; `scancel` itself says why it does not."""
    with suppress(OSError):  # there is no `scancel`, or no process for it
        job.cancel(check=False)


def queued_jobs() -> set[str] | None:
    """Asks SLURM for this user's jobs."""
    command = ["squeue", "--me", "--noheader", "--format=%A"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:  # there is no `squeue`, or no process for it
        return None
    return set(found.stdout.split()) if found.returncode == 0 else None


def open_slurm(partition: str | None, folder: Path, minutes: int) -> Executor:
    """Returns an executor whose calls are SLURM jobs, which end after some minutes.

    The partition is the default one without a name; all nodes see the folder of submitit's files.

    Raises:
        MissingExtraError: submitit is not installed.
        EngineError: there is no SLURM here.
    """
    require_extra("submitit", "slurm", "the engine slurm")
    import submitit  # noqa: PLC0415  (an extra)

    try:
        submitter = submitit.AutoExecutor(folder=folder, cluster="slurm")
    except RuntimeError as error:
        raise EngineError(
            f"this machine cannot submit to SLURM ({error}). Run the command where `sbatch` is."
        ) from error
    places = {} if partition is None else {"slurm_partition": partition}
    submitter.update_parameters(
        timeout_min=minutes,
        cpus_per_task=1,
        name="swarmdata",
        slurm_setup=[f"export {name}=1" for name in THREAD_VARIABLES],
        **places,
    )
    return SlurmExecutor(submitter, queued_jobs)
