"""Threads that run the parts of one piece of work at the same time, again and again.

Each part must be a function that leaves the interpreter for most of its time, as compiled kernels
and large array operations do. Handing a part to a waiting thread and hearing that it has finished
takes 25 us, so parts may be as short as some hundred.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from threading import Barrier

Part = Callable[[], object]


class ThreadTeam:
    """Runs up to `size` parts at once: the first in the calling thread, the others in a pool's.

    The threads start with the first work, wait without using the processor, and end with `close`,
    with the team, or with the process. After a fork the child starts threads of its own.

    Args:
        size: number of threads, the caller's included.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0  # in which the threads run

    def run(self, parts: Sequence[Part]) -> None:
        """Runs all parts and returns when the last has finished.

        Args:
            parts: at most `size`.

        Raises:
            BaseException: what a part raised, unchanged; of several, that of the first part. It is
                raised once all parts have finished, and so is an interrupt (Ctrl-C).
        """
        if len(parts) == 1:
            parts[0]()
            return
        if self._pool is None or self._process != os.getpid():
            pool, meet = ThreadPoolExecutor(self.size - 1, "swarmdata-step"), Barrier(self.size - 1)
            wait([pool.submit(meet.wait) for _ in range(self.size - 1)])  # all threads are there
            self._pool, self._process = pool, os.getpid()
        try:
            others = [self._pool.submit(part) for part in parts[1:]]
            parts[0]()
            for each in others:
                each.result()
        except BaseException:
            self.close()  # waits for all, also for one that an interrupt has just handed over
            raise

    def close(self) -> None:
        """Ends the threads when they have finished; `run` would start new ones."""
        pool, self._pool = self._pool, None
        if pool is not None and self._process == os.getpid():
            pool.shutdown()
