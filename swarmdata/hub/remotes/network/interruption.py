"""Interruption of jobs in threads: a job that is not wanted any more ends at its next look."""

import threading
import time
from contextvars import ContextVar

SLICE_SECONDS = 0.25
"""Seconds between two looks at whether to stop."""

STOP_EVENT: ContextVar[threading.Event | None] = ContextVar("stop", default=None)
"""Of the jobs of this thread; set once they are not wanted any more."""


class StoppedError(BaseException):
    """The job is not wanted any more; no failure of a remote, so nobody tries it again."""


def check_stop() -> None:
    """Ends the job of this thread if it is not wanted any more.

    Raises:
        StoppedError: another job failed, or the user pressed Ctrl-C.
    """
    stop = STOP_EVENT.get()
    if stop is not None and stop.is_set():
        raise StoppedError


def pause(seconds: float) -> None:
    """Sleeps, unless the job of this thread is not wanted any more.

    Raises:
        StoppedError: it is not.
    """
    stop = STOP_EVENT.get()
    if stop is None:
        time.sleep(seconds)
    else:
        stop.wait(seconds)
        check_stop()
