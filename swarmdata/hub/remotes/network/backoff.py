"""Backoff, how often and after how long a remote is asked again; and how waiting is interrupted."""

import errno
import threading
import time
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

from swarmdata.errors import HubError
from swarmdata.runtime.cache_folder import offline_variable

T = TypeVar("T")

SLICE_SECONDS = 0.25  # seconds between two looks at whether to stop

STOP_EVENT: ContextVar[threading.Event | None] = ContextVar("stop", default=None)
"""Of the jobs of this thread; set once they are not wanted any more."""


class StoppedError(BaseException):
    """The job was cancelled; this is no failure of a remote, so it is not tried again."""


def check_stop() -> None:
    """Raises `StoppedError` if another job failed, or the user pressed Ctrl-C."""
    stop = STOP_EVENT.get()
    if stop is not None and stop.is_set():
        raise StoppedError


def pause(seconds: float) -> None:
    """Sleeps; raises `StoppedError` as soon as the job of this thread is not wanted any more."""
    stop = STOP_EVENT.get()
    if stop is None:
        time.sleep(seconds)
    else:
        stop.wait(seconds)
        check_stop()


LOCAL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Failures of this machine's disk, which no other attempt and no other remote can change."""

SLOW_ATTEMPTS = 2
"""How often a server is asked that takes all of its time; `Backoff` asks others more often."""

NETWORK_ADVICE = (
    "Datasets in the cache still load. Try again later, or name another remote "
    "(`swarmdata remote list` shows those that are asked)."
)
"""What to do when a remote does not answer."""


class TransientError(Exception):
    """A failure that may pass; `after` is how many seconds the server asked to wait."""

    def __init__(self, message: str, after: float | None = None) -> None:
        super().__init__(message)
        self.after = after


class TooSlowError(TransientError):
    """A server is slower than it may be; asked once more, and then no more."""


Explained = Callable[[Exception, str], Exception | None]
"""Our error for one of a client library, given what was done; None for one that stays as it is."""


@dataclass(frozen=True)
class Backoff:
    """Tries again after waits that double."""

    attempts: int = 5  # how often at most, the first time included
    wait: float = 1.0  # seconds before the second attempt
    longest: float = 30.0  # most seconds between two attempts, whatever the server asks for
    sleep: Callable[[float], None] = pause  # waits; tests replace it

    def run(self, what: str, action: Callable[[], T]) -> T:
        """Returns what `action` returns, once it does not raise `TransientError`.

        Every other error ends the attempts. `what` says in messages what is done, such as "asking
        hf://org for its datasets".

        Raises:
            HubError: every attempt failed.
        """
        for attempt in range(1, self.attempts + 1):
            try:
                return action()
            except TransientError as error:
                limit = min(self.attempts, SLOW_ATTEMPTS)
                if attempt == (limit if isinstance(error, TooSlowError) else self.attempts):
                    times = "once" if attempt == 1 else f"{attempt} times"
                    raise HubError(f"{what} failed {times}: {error}. {NETWORK_ADVICE}") from error
                wait = self.wait * 2 ** (attempt - 1) if error.after is None else error.after
            self.sleep(min(wait, self.longest))
        raise ValueError(f"attempts is {self.attempts}, expected at least 1")

    def call(self, address: str, what: str, action: Callable[[], T], explained: Explained) -> T:
        """Runs a call of a client library as `run` does, unless the user is offline."""

        def attempt() -> T:
            refuse_offline(address)
            try:
                return action()
            except (HubError, TransientError):
                raise
            except Exception as error:
                ours = explained(error, what)
                if ours is None:
                    raise
                raise ours from error

        return self.run(what, attempt)


def seconds(text: str | None) -> float | None:
    """The seconds in a `Retry-After` header, None if it is absent or a date."""
    return float(text) if text and text.strip().isdecimal() else None


def refuse_offline(address: str) -> None:
    """Raises HubError where the user has said that no network shall be used."""
    if name := offline_variable():
        raise HubError(
            f"{address} is not asked, because {name} is set. Datasets in the cache still load; "
            f"unset {name} to use the network."
        )
