"""How slow a remote may be: an answer has a deadline, and what is fetched a least rate."""

import contextlib
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Self, TypeVar

from swarmdata.errors import HubError
from swarmdata.hub.remotes.network.backoff import (
    SLICE_SECONDS,
    STOP_EVENT,
    TooSlowError,
    check_stop,
)


@dataclass(frozen=True)
class Pace:
    """How fast a remote must answer; each field has an environment variable."""

    answer_seconds: float = 30.0
    """Until the headers of an answer are complete, the connection included; of `hf://` and object
    stores, until a question is answered (`SWARMDATA_ANSWER_SECONDS`)."""
    least_rate: float = 1024.0
    """Bytes a second of a file, as a mean over a window (`SWARMDATA_LEAST_RATE`)."""
    window_seconds: float = 30.0  # of that window (`SWARMDATA_RATE_SECONDS`)

    @classmethod
    def from_environment(cls) -> Self:
        """The defaults, or what the environment says."""
        plain = cls()
        return cls(
            _number("SWARMDATA_ANSWER_SECONDS", plain.answer_seconds),
            _number("SWARMDATA_LEAST_RATE", plain.least_rate),
            _number("SWARMDATA_RATE_SECONDS", plain.window_seconds),
        )


def _number(name: str, otherwise: float) -> float:
    text = os.environ.get(name, "")
    if not text:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise HubError(f"{name} is {text!r}, expected a positive number. Correct or unset it.")
    return value


@dataclass
class Meter:
    """Watches one answer: first its headers against the deadline, then its body's rate."""

    pace: Pace  # what is expected
    what: str  # is slow, for the message, such as a URL
    clock: Callable[[], float] = time.monotonic  # seconds; tests replace it
    since: float = field(init=False)  # begin of the waiting, or of the window
    n_bytes: int = field(default=0, init=False)  # in this window
    is_body: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self.since = self.clock()

    def begin_body(self) -> None:
        """The headers are there: from now on the rate counts."""
        self.since, self.n_bytes, self.is_body = self.clock(), 0, True

    def count(self, n_bytes: int) -> None:
        self.n_bytes += n_bytes

    def seconds_left(self) -> float:
        """Until this is asked again at the latest.

        Raises:
            TooSlowError: the deadline is over, or the rate was too low in the last window.
        """
        limit = self.pace.window_seconds if self.is_body else self.pace.answer_seconds
        left = self.since + limit - self.clock()
        if left > 0:
            return left
        if not self.is_body:
            raise TooSlowError(f"{self.what} did not answer within {limit:g} s")
        if self.n_bytes < self.pace.least_rate * limit:
            raise TooSlowError(
                f"{self.what} gave {self.n_bytes:,} bytes in {limit:g} s, fewer than the least "
                f"rate of {self.pace.least_rate:g} bytes/s (SWARMDATA_LEAST_RATE)"
            )
        self.begin_body()
        return limit


T = TypeVar("T")

GRACE_SECONDS = 1.0  # seconds in which threads may end by themselves


def _called(call: Callable[[], T]) -> Future[T]:
    """The result or the exception of a call."""
    outcome = Future[T]()
    try:
        outcome.set_result(call())
    except BaseException as error:
        outcome.set_exception(error)
    return outcome


def run_all(
    jobs: Sequence[Callable[[], None]], n_threads: int, tick: Callable[[], None], seconds: float
) -> None:
    """Runs jobs in their order, `n_threads` at a time; the first error, or Ctrl-C, stops the rest.

    `tick` is called every so many seconds meanwhile, and at the end.
    """
    stop = threading.Event()
    waiting, finished = deque(jobs), SimpleQueue[Future[None]]()

    def work() -> None:
        STOP_EVENT.set(stop)  # a thread has a context of its own
        while waiting and not stop.is_set():
            try:
                job = waiting.popleft()
            except IndexError:  # another thread took the last one
                return
            outcome = _called(job)
            if outcome.exception() is not None:
                stop.set()
            finished.put(outcome)

    threads = [threading.Thread(target=work, daemon=True) for _ in range(n_threads)]
    try:
        for thread in threads:
            thread.start()
        n_finished = 0
        while n_finished < len(jobs):
            try:
                finished.get(timeout=seconds).result()
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
    """Calls a client library that has no limit for slow servers, in a thread of its own.

    The thread is left alone once it is too slow. `arrived` says how many bytes have arrived so far;
    without it there is a deadline, and no rate.
    """
    finished, seen = SimpleQueue[Future[T]](), 0
    if arrived is not None:
        seen = arrived()
        meter.begin_body()
    threading.Thread(target=lambda: finished.put(_called(call)), daemon=True).start()
    while True:
        try:
            return finished.get(timeout=SLICE_SECONDS).result()
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
