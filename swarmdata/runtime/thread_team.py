"""Threads that run the parts of one piece of work at the same time, again and again.

Each part must be a function that leaves the interpreter for most of its time, as compiled kernels
and large array operations do. Handing a part to a waiting thread and hearing that it has finished
takes 13 us, so parts may be as short as a hundred.
"""

import os
import threading
import weakref
from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue

Part = Callable[[], object]

_Orders = SimpleQueue[Part | None]


class ThreadTeam:
    """Runs up to `size` parts at once: the first in the calling thread, the others in its own.

    The threads start with the first work, wait without using the processor, and end with `close`,
    with the team, or with the process. After a fork the child starts threads of its own.

    Args:
        size: number of threads, the caller's included.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._orders: list[_Orders] = []
        self._process = 0  # in which the threads run
        self._end: weakref.finalize[..., ThreadTeam] | None = None

    def run(self, parts: Sequence[Part]) -> None:
        """Runs all parts and returns when the last has finished.

        Args:
            parts: at most `size`.

        Raises:
            BaseException: what a part raised, unchanged; of several, that of the first part. It is
                raised once all parts have finished, and so is an interrupt (Ctrl-C).
        """
        if len(parts) > 1 and self._process != os.getpid():
            self._start()
        finished: list[tuple[int, BaseException | None]] = []
        # An interrupt may strike when a signal has just been taken from the queue. So `finished`
        # decides, and the queue only wakes; it is a new one, since signals may be left in it.
        signals: SimpleQueue[None] = SimpleQueue()
        try:
            for index in range(1, len(parts)):
                part = partial(_report, index, parts[index], finished, signals)
                self._orders[index - 1].put(part)
            parts[0]()
            while len(finished) < len(parts) - 1:
                signals.get()
        except BaseException:
            self._wait_until_idle()
            raise
        problems = {index: error for index, error in finished if error is not None}
        finished.clear()
        try:
            if problems:
                raise problems[min(problems)]
        finally:
            problems.clear()  # tracebacks hold this frame

    def close(self) -> None:
        """Ends the threads; `run` would start new ones."""
        if self._end is not None and self._process == os.getpid():
            self._end()
        self._process = 0

    def _start(self) -> None:
        """Starts the threads, of which a forked process has none."""
        self._orders = [SimpleQueue() for _ in range(self.size - 1)]
        threads = [
            threading.Thread(target=_serve, args=(orders,), name="swarmdata-step", daemon=True)
            for orders in self._orders
        ]
        for thread in threads:
            thread.start()
        self._process = os.getpid()
        self._end = weakref.finalize(self, _end_threads, self._orders, threads)

    def _wait_until_idle(self) -> None:
        """Waits until all threads have finished; an interrupt meanwhile is raised afterwards."""
        interrupt: KeyboardInterrupt | None = None
        for orders in self._orders if self._process == os.getpid() else ():
            is_idle = threading.Event()
            orders.put(is_idle.set)
            while not is_idle.is_set():
                try:
                    is_idle.wait()
                except KeyboardInterrupt as error:
                    interrupt = error
        if interrupt is not None:
            raise interrupt


def _report(
    index: int,
    part: Part,
    finished: list[tuple[int, BaseException | None]],
    signals: SimpleQueue[None],
) -> None:
    """Runs a part, and says that it has finished and what it raised."""
    problem = None
    try:
        part()
    except BaseException as error:  # the caller raises it
        problem = error
    del part
    finished.append((index, problem))
    del problem
    signals.put(None)


def _serve(orders: _Orders) -> None:
    """Runs orders until there is None; keeps nothing of an order that it has run."""
    while (order := orders.get()) is not None:
        order()
        del order


def _end_threads(orders: Sequence[_Orders], threads: Sequence[threading.Thread]) -> None:
    for each in orders:
        each.put(None)
    for thread in threads:
        thread.join()
