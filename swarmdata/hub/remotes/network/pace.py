"""How slow a remote may be before it is left for the next one.

A server that sends a byte now and then keeps a connection alive for ever, so a timeout of single
reads is not enough: an answer has a deadline, and what is fetched a least rate.
"""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from swarmdata.errors import HubError
from swarmdata.hub.remotes.network.backoff import TooSlowError


@dataclass(frozen=True)
class Pace:
    """How fast a remote must answer; each field has an environment variable.

    Attributes:
        answer_seconds: until the headers of an answer are complete, the connection included; of
            `hf://` and object stores, until a question is answered (`SWARMDATA_ANSWER_SECONDS`).
        least_rate: bytes a second of a file, as a mean over a window (`SWARMDATA_LEAST_RATE`).
        window_seconds: of that window (`SWARMDATA_RATE_SECONDS`).
    """

    answer_seconds: float = 30.0
    least_rate: float = 1024.0
    window_seconds: float = 30.0

    @classmethod
    def from_environment(cls) -> Self:
        """The defaults, or what the environment says.

        Raises:
            HubError: a variable is not a positive number.
        """
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
    """Watches one answer: first its headers against the deadline, then its body's rate.

    Attributes:
        pace: what is expected.
        what: is slow, for the message, such as a URL.
        clock: seconds; tests replace it.
    """

    pace: Pace
    what: str
    clock: Callable[[], float] = time.monotonic
    since: float = field(init=False)  # begin of the waiting, or of the window
    n_bytes: int = field(default=0, init=False)  # in this window
    is_body: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Begins to wait for the answer."""
        self.since = self.clock()

    def begin_body(self) -> None:
        """The headers are there: from now on the rate counts."""
        self.since, self.n_bytes, self.is_body = self.clock(), 0, True

    def count(self, n_bytes: int) -> None:
        """Adds bytes that have arrived."""
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
