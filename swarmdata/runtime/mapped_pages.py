"""Pages of mapped files: given back after they have been read, so that memory stays bounded."""

import mmap
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

READ_BYTES = 32 << 20  # bytes that become resident between two times that pages are given back

REGION_BYTES = 2 << 20
"""Most bytes that a read of a few makes resident: a huge page, where the cache has one."""


class MappedReads:
    """Counts what is read of some arrays, and gives their mapped pages back every `READ_BYTES`."""

    def __init__(self, arrays: Iterable[NDArray[Any]]) -> None:
        self._arrays = tuple(arrays)
        self._regions: set[int] = set()  # that were read, by their number in memory

    def add(self, *values: NDArray[Any]) -> None:
        """Counts rows that have been read, views of the arrays."""
        for each in values:
            low, high = _extent(each)
            self._regions.update(range(low // REGION_BYTES, -(-high // REGION_BYTES)))
        if len(self._regions) * REGION_BYTES >= READ_BYTES:
            self.release()

    def release(self) -> None:
        """Gives back all pages of the arrays."""
        self._regions.clear()
        for array in self._arrays:
            release_pages(array)


def take_rows(array: NDArray[Any], rows: NDArray[np.int64]) -> NDArray[Any]:
    """Returns a copy of some rows, [n, ...], of which few pages are resident at a time.

    They may be in any order, increasing ones fastest; none is negative or beyond the end.
    """
    taken = np.empty((len(rows), *array.shape[1:]), dtype=array.dtype)
    regions = rows // max(1, READ_BYTES // max(1, array[:1].nbytes))  # of the file
    ends = np.append(np.flatnonzero(np.diff(regions)) + 1, len(rows))
    n_apart, first = max(1, READ_BYTES // REGION_BYTES), 0  # rows that may be in other regions
    while first < len(rows):
        last = max(ends[np.searchsorted(ends, first, side="right")], first + n_apart)
        if array.flags.c_contiguous:  # mode: the others copy through a buffer
            array.take(rows[first:last], axis=0, out=taken[first:last], mode="clip")
        else:
            taken[first:last] = array[rows[first:last]]
        release_pages(array)
        first = last
    return taken


def gather_rows(array: NDArray[Any], rows: NDArray[np.int64]) -> NDArray[Any]:
    """Returns a copy of some rows, whose pages stay resident, unlike with `take_rows`.

    `take` is faster, but first copies the whole of an array that is not contiguous, such as a side.
    """
    return array.take(rows, axis=0) if array.flags.c_contiguous else array[rows]


def release_pages(array: NDArray[Any]) -> None:
    """Gives back the pages under a view of a mapped file; an array in memory is left alone."""
    mapped = mapping_of(array)
    if mapped is None or not array.size:
        return
    begin, _ = _extent(np.frombuffer(mapped, dtype=np.uint8))
    low, high = (address - begin for address in _extent(array))
    first = low // mmap.PAGESIZE * mmap.PAGESIZE
    mapped.madvise(mmap.MADV_DONTNEED, first, high - first)


def _extent(array: NDArray[Any]) -> tuple[int, int]:
    """Addresses of an array's first byte and of the byte after its last one."""
    low = high = array.__array_interface__["data"][0]
    if not array.size:
        return low, low
    for size, stride in zip(array.shape, array.strides, strict=True):
        low, high = low + min(0, (size - 1) * stride), high + max(0, (size - 1) * stride)
    return low, high + array.itemsize


def mapping_of(array: NDArray[Any]) -> mmap.mmap | None:
    """The map of a file that an array is a view of; None: it is in memory, or without elements."""
    base: Any = array
    while isinstance(base, np.ndarray | memoryview):
        base = base.obj if isinstance(base, memoryview) else base.base
    return base if isinstance(base, mmap.mmap) else None
