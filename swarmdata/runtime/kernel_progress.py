"""Says once in a command that kernels are compiled, and about how long that will take."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

QUIET_TIME = 3.0  # seconds of compiling before anything is said
N_MEASURED = 10  # kernels that give a pace; numba's own start is a part of the time of the first

_LOG = logging.getLogger("swarmdata")


class KernelProgress:
    """Counts the kernels that this process compiles, and the time that it takes."""

    def __init__(self) -> None:
        self.kernels: list[Any] = []  # all that have been defined, but those copied into others
        self.n_compiled = 0  # for each kernel and types, by this process or one it waited for
        self.tell: Callable[[str], None] | None = _LOG.warning  # None: nobody says any more
        self._depth = 0
        self._spent, self._begin = 0.0, 0.0  # s

    def begin(self) -> None:
        """A compilation begins, perhaps within another one."""
        if self._depth == 0:
            self._begin = time.perf_counter()
        self._depth += 1

    def end(self, module: str) -> None:
        """The compilation that began last ends, of a function that a module of anybody defines."""
        self._depth -= 1
        spent = self._spent + time.perf_counter() - self._begin
        if self._depth == 0:
            self._spent = spent
        if module.startswith("swarmdata."):
            self.n_compiled += 1
            if spent > QUIET_TIME and self.n_compiled >= N_MEASURED:
                self.say(self.estimate(spent))

    def waited(self) -> None:
        """Another process has compiled a kernel meanwhile."""
        self.n_compiled += 1

    def say(self, text: str) -> None:
        """Says the one line of a command, unless it has been said."""
        if self.tell is not None:
            tell, self.tell = self.tell, None
            tell(text)

    def estimate(self, spent: float) -> str:
        """What happens, and how long it will take at the pace of the seconds spent so far."""
        n_left = sum(not kernel.overloads for kernel in self.kernels)
        seconds = n_left * spent / self.n_compiled
        return (
            f"compiling kernels, once for this version on this machine: {self.n_compiled} in "
            f"{spent:.0f} s, at most {n_left} are left, which take {seconds:.0f} s at this pace "
            "('swarmdata warm' does it beforehand)"
        )

    @contextmanager
    def silent(self) -> Iterator[None]:
        before, self.tell = self.tell, None
        try:
            yield
        finally:
            self.tell = before


PROGRESS = KernelProgress()  # of this process
