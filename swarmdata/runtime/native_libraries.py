"""Native libraries in this process: how many threads products take, and what is freed."""

import ctypes
import sys
from collections.abc import Sequence
from functools import cache, lru_cache

from threadpoolctl import LibController, ThreadpoolController

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # parameters of mallopt(3)

SIZES = (1 << 30, 1 << 25)
"""Bytes below which freed blocks are kept; older releases of glibc take 32 MiB at most."""


@cache
def keep_freed_memory() -> bool:
    """Tells the allocator of glibc, for the rest of the process, not to give freed memory back.

    Updates of an algorithm free and take the same large blocks each time, and would spend up to
    half of their time on new pages. The process keeps its largest size.

    Returns:
        Whether that was done; other allocators than that of glibc are left alone.
    """
    if sys.platform != "linux":
        return False
    library = ctypes.CDLL(None)
    if not hasattr(library, "gnu_get_libc_version"):
        return False
    kept = any(library.mallopt(M_MMAP_THRESHOLD, size) for size in SIZES)
    return kept and bool(library.mallopt(M_TRIM_THRESHOLD, (1 << 31) - 1))


class ThreadLimit:
    """A context in which BLAS and OpenMP, and so NumPy's and torch's products, use few threads.

    The networks of policies are too small to gain from a second thread, and waiting threads spin.
    Libraries that are loaded after the limit was made are not limited. A limit can be entered again
    after it was left.
    """

    def __init__(self, n_threads: int = 1) -> None:
        self._n_threads = n_threads
        self._libraries = _libraries(len(sys.modules))
        self._before: list[int] = []

    def __enter__(self) -> None:
        # `ThreadpoolController.limit` does the same, in 13 us instead of 1: too slow for every step
        self._before = [library.get_num_threads() for library in self._libraries]
        self._set([self._n_threads] * len(self._before))

    def __exit__(self, *_: object) -> None:
        self._set(self._before)

    def _set(self, numbers: Sequence[int]) -> None:
        for library, n_threads, before in zip(self._libraries, numbers, self._before, strict=True):
            if before != self._n_threads:
                library.set_num_threads(n_threads)


@lru_cache(maxsize=1)
def _libraries(n_modules: int) -> Sequence[LibController]:
    """The loaded libraries with threads; looking for them takes 12 ms."""
    return ThreadpoolController().lib_controllers
