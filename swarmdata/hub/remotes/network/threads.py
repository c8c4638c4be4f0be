"""Threads that fetch, and that never keep a program from ending.

They are daemons, and what they wait for they wait for in short slices: a job that another one's
error, or Ctrl-C, has made useless ends within `SLICE` seconds. Where a client library waits for a
server, nobody can interrupt it; its thread is left alone then, and ends with the process.
"""

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from swarmdata.hub.remotes.network.interruption import SLICE_SECONDS, STOP_EVENT, check_stop
from swarmdata.hub.remotes.network.pace import Meter

T = TypeVar("T")

GRACE_SECONDS = 1.0
"""Seconds in which threads may end by themselves."""


class _Outcome(Generic[T]):
    """What a call returned or raised."""

    def __init__(self, call: Callable[[], T]) -> None:
        self.error: BaseException | None = None
        try:
            self.value = call()
        except BaseException as error:
            self.error = error

    def get(self) -> T:
        if self.error is not None:
            raise self.error
        return self.value


def run_all(
    jobs: Sequence[Callable[[], None]], n_threads: int, tick: Callable[[], None], seconds: float
) -> None:
    """Runs jobs a few at a time; the first error, or Ctrl-C, stops the rest.

    Args:
        jobs: in the order in which they are begun.
        n_threads: how many run at a time.
        tick: called again and again meanwhile, and at the end.
        seconds: between two calls of `tick`.
    """
    stop = threading.Event()
    waiting, finished = deque(jobs), SimpleQueue[_Outcome[None]]()

    def work() -> None:
        STOP_EVENT.set(stop)  # a thread has a context of its own
        while waiting and not stop.is_set():
            try:
                job = waiting.popleft()
            except IndexError:  # another thread took the last one
                return
            outcome = _Outcome(job)
            if outcome.error is not None:
                stop.set()
            finished.put(outcome)

    threads = [threading.Thread(target=work, daemon=True) for _ in range(n_threads)]
    try:
        for thread in threads:
            thread.start()
        n_finished = 0
        while n_finished < len(jobs):
            try:
                finished.get(timeout=seconds).get()
                n_finished += 1
            except Empty:
                tick()
        tick()
    finally:
        stop.set()
        end = time.monotonic() + GRACE_SECONDS
        for thread in threads:
            if thread.is_alive():
                thread.join(max(0.0, end - time.monotonic()))


def watched(call: Callable[[], T], meter: Meter, arrived: Callable[[], int] | None = None) -> T:
    """Calls a client library that cannot be told how slow a server may be.

    Args:
        call: what to do, in a thread that is left alone once it is too slow.
        meter: of what is expected.
        arrived: how many bytes have arrived so far; None: there is a deadline, and no rate.

    Raises:
        TooSlowError: it was.
        StoppedError: the job of this thread is not wanted any more.
    """
    finished, seen = SimpleQueue[_Outcome[T]](), 0
    if arrived is not None:
        seen = arrived()
        meter.begin_body()
    threading.Thread(target=lambda: finished.put(_Outcome(call)), daemon=True).start()
    while True:
        try:
            return finished.get(timeout=SLICE_SECONDS).get()
        except Empty:
            check_stop()
        if arrived is not None:
            now = arrived()
            meter.count(max(0, now - seen))
            seen = now
        meter.seconds_left()


def bytes_in(folder: Path) -> int:
    """The bytes of all files below a folder, which may change meanwhile."""
    total = 0
    for root, _, names in os.walk(folder):  # which passes over folders that vanish
        for name in names:
            with contextlib.suppress(FileNotFoundError):  # renamed meanwhile
                total += Path(root, name).stat().st_size
    return total
