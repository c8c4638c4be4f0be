"""Writes HDF5 files so that a full disk is an error and not a crash.

The HDF5 library cannot close a file after a failed write: it crashes the process (h5py 3.16 with
HDF5 1.14 and 2.0, in `H5F_close`). It therefore writes to a Python file that hides the first
failure, holds everything written afterwards in memory, and raises when the library has finished.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import RawIOBase
from pathlib import Path
from typing import Any


class _FailSafeFile(RawIOBase):
    """The file that h5py writes; its methods never fail."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor, self.position = descriptor, 0
        self.failure: OSError | None = None
        self.later: list[tuple[int, bytes]] = []  # position and content, after the failure

    def write(self, data: Any) -> int:
        content = memoryview(data).cast("B")
        if self.failure is None:
            n_written = 0
            try:
                while n_written < len(content):
                    n_written += os.pwrite(
                        self.descriptor, content[n_written:], self.position + n_written
                    )
            except OSError as error:
                self.failure = error
        if self.failure is not None:
            self.later.append((self.position, bytes(content)))
        self.position += len(content)
        return len(content)

    def readinto(self, buffer: Any) -> int:
        target = memoryview(buffer).cast("B")
        begin, end = self.position, self.position + len(target)
        on_disk = os.pread(self.descriptor, len(target), begin)
        target[:] = on_disk.ljust(len(target), b"\0")
        for first, content in self.later:
            low, high = max(first, begin), min(first + len(content), end)
            if low < high:
                target[low - begin : high - begin] = content[low - first : high - first]
        self.position = end
        return len(target)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        ends = [first + len(content) for first, content in self.later]
        size = max([os.fstat(self.descriptor).st_size, *ends])
        self.position = {os.SEEK_SET: 0, os.SEEK_CUR: self.position, os.SEEK_END: size}[whence]
        self.position += offset
        return self.position

    def truncate(self, size: int) -> int:  # type: ignore[override]  # h5py always gives it
        if self.failure is None:
            try:
                os.ftruncate(self.descriptor, size)
            except OSError as error:
                self.failure = error
        return size

    def check(self) -> None:
        """Raises the first failed write."""
        if self.failure is not None:
            raise self.failure


@contextmanager
def create_hdf5(path: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Opens a new HDF5 file for writing.

    Yields:
        h5py's file, and a function that raises the first failed write, an OSError; called after
        each block, it bounds the memory.
    """
    import h5py  # noqa: PLC0415  (heavy)

    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        sink = _FailSafeFile(descriptor)
        with h5py.File(sink, "w") as file:
            yield file, sink.check
        sink.check()
    finally:
        os.close(descriptor)
