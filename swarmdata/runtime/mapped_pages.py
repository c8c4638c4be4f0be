"""Pages of mapped files: given back after they have been read, so that memory stays bounded.

A page of a memory map counts as memory of the process from its first read on. Whoever reads a whole
dataset gives pages back on the way. The system still has them in its cache, and maps them again
when they are read again.
"""

import mmap
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

READ_BYTES = 128 << 20
"""Bytes that become resident between two times that pages are given back."""

NEIGHBOR_BYTES = 2 << 20
"""Most bytes that a read of a few makes resident: a huge page, where the cache has one."""


class MappedReads:
    """Counts what is read of some arrays, and gives their pages back every `READ_BYTES`.

    Args:
        arrays: mapped or in memory; what is in memory stays there.
    """

    def __init__(self, arrays: Iterable[NDArray[Any]]) -> None:
        self._arrays = tuple(arrays)
        self._n_bytes = 0

    def add(self, *values: NDArray[Any]) -> None:
        """Counts rows that have been read."""
        self._n_bytes += sum(max(each.nbytes, NEIGHBOR_BYTES) for each in values)
        if self._n_bytes >= READ_BYTES:
            self.release()

    def release(self) -> None:
        """Gives back all pages of the arrays."""
        self._n_bytes = 0
        for array in self._arrays:
            release_pages(array)


def take_rows(array: NDArray[Any], rows: NDArray[np.int64]) -> NDArray[Any]:
    """Returns a copy of some rows, [n, ...], of which few pages are resident at a time."""
    taken = np.empty((len(rows), *array.shape[1:]), dtype=array.dtype)
    n_rows = max(1, READ_BYTES // NEIGHBOR_BYTES)
    for first in range(0, len(rows), n_rows):
        taken[first : first + n_rows] = array[rows[first : first + n_rows]]
        release_pages(array)
    return taken


def release_pages(array: NDArray[Any]) -> None:
    """Gives back the pages under a view of a mapped file; an array in memory is left alone."""
    mapped = mapping_of(array)
    if mapped is None or not array.size:
        return
    begin = np.frombuffer(mapped, dtype=np.uint8).__array_interface__["data"][0]
    low = high = array.__array_interface__["data"][0] - begin
    for size, stride in zip(array.shape, array.strides, strict=True):
        low, high = low + min(0, (size - 1) * stride), high + max(0, (size - 1) * stride)
    first = low // mmap.PAGESIZE * mmap.PAGESIZE
    mapped.madvise(mmap.MADV_DONTNEED, first, high + array.itemsize - first)


def mapping_of(array: NDArray[Any]) -> mmap.mmap | None:
    """The map of a file that an array is a view of; None: it is in memory, or without elements."""
    base: Any = array
    while isinstance(base, np.ndarray | memoryview):
        base = base.obj if isinstance(base, memoryview) else base.base
    return base if isinstance(base, mmap.mmap) else None
