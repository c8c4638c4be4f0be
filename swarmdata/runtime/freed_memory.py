"""keep_freed_memory: a process keeps what it frees, for work that frees and takes it in turns."""

import ctypes
import sys
from functools import cache

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Parameters of mallopt(3)."""

SIZES = (1 << 30, 1 << 25)
"""Bytes below which freed blocks are kept; older releases of glibc take 32 MiB at most."""


@cache
def keep_freed_memory() -> bool:
    """Tells the allocator of glibc, for the rest of the process, not to give freed memory back.

    By default every block of more than 32 MiB, and every large end of the heap, goes back to the
    system when it is freed, and the next one is filled with zeros page by page. The updates of an
    algorithm free and take the same blocks each time, and would spend up to half of their time so.
    The process keeps its largest size.

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
