"""Jobs, JSON values that any process can do; doing one twice leaves the files of doing it once."""

import os
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from swarmdata.errors import BuildError, SwarmdataError
from swarmdata.runtime.own_components import import_component

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""Environment variables that are 1 in processes that do jobs: each job has one core."""

MAX_ATTEMPTS = 3  # how often a job is begun at most, when the processes that do it are lost


def usable_cores() -> int:
    """How many cores this process may use, such as `taskset` or a batch system allows it."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


Report = Callable[[int], None]
"""Gets the progress since its last call; negative when a lost job starts again."""

Handler = Callable[[dict[str, Any], Report], None]  # does a job, given its payload


@dataclass(frozen=True)
class Job:
    """One piece of work."""

    name: str  # for messages, such as "part 3 of expert-0"
    payload: dict[str, Any]  # JSON values, given to the handler


OnFailure = Callable[[Job, BuildError], None]
"""Gets a job that raised an error, or was lost `MAX_ATTEMPTS` times; the others go on."""


def stop_at_failure(_job: Job, error: BuildError) -> None:
    """Raises the error: the first failure ends the whole run."""
    raise error


def load_handler(entry: str) -> Handler:
    """Returns what `module:function` returns, which is called without arguments."""
    handler: Handler = import_component(entry)()
    return handler


_handlers: dict[str, Handler] = {}
_one_at_a_time = threading.Lock()


def do_job(entry: str, payload: dict[str, Any]) -> dict[str, Any]:
    """Does a job in this process, which keeps the handler of `entry` for the next one.

    Returns:
        `progress`, the sum of what the handler reported, or `error`: not every engine can send
        every exception.
    """
    reports: list[int] = []
    with _one_at_a_time:  # an engine's process may have several threads; handlers have one
        try:
            if entry not in _handlers:
                _handlers[entry] = load_handler(entry)
            _handlers[entry](payload, reports.append)
        except (SwarmdataError, OSError) as error:
            return {"error": f"{type(error).__name__}: {error}"}
        except Exception:
            return {"error": f"a bug:\n{traceback.format_exc()}"}
    return {"progress": sum(reports)}
