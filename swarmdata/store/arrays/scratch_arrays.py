"""Arrays that are computed and kept: small ones in memory, large ones in files without a name."""

import mmap
import os
import sys
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.runtime.atomic import disk_full_explained
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.runtime.mapped_pages import mapping_of

MEMORY_BYTES = 256 << 20  # most bytes of arrays that are kept in memory; more are in files


class ScratchMap(mmap.mmap):
    """A map of a file that has no name: it goes with the last array that is a view of it.

    Its descriptor is kept, so that other processes of this machine can map the file (`share`).
    """

    descriptor: int

    def __new__(cls, descriptor: int, n_bytes: int, **access: int) -> "ScratchMap":
        self = super().__new__(cls, descriptor, n_bytes, **access)
        self.descriptor = os.dup(descriptor)
        weakref.finalize(self, os.close, self.descriptor)
        return self


class SharedArray(NamedTuple):
    """Where another process of this machine finds an array, while this one keeps it."""

    path: str  # of the descriptor of the process that has it
    file: tuple[int, int]  # device and inode
    dtype: str
    shape: tuple[int, ...]


def share(array: NDArray[Any]) -> SharedArray | None:
    """Says where other processes find an array of `new_arrays`; None: it is in no file."""
    mapped = mapping_of(array)
    if not isinstance(mapped, ScratchMap) or array.nbytes != len(mapped):
        return None
    found = os.fstat(mapped.descriptor)
    path = f"/proc/{os.getpid()}/fd/{mapped.descriptor}"
    return SharedArray(path, (found.st_dev, found.st_ino), array.dtype.str, array.shape)


def map_shared(shared: SharedArray) -> NDArray[Any] | None:
    """Maps an array of another process, read-only; None: that process, or its array, is gone."""
    try:
        descriptor = os.open(shared.path, os.O_RDONLY)
    except OSError:
        return None
    try:
        found = os.fstat(descriptor)
        if (found.st_dev, found.st_ino) != shared.file:
            return None
        mapped = ScratchMap(descriptor, found.st_size, access=mmap.ACCESS_READ)
    finally:
        os.close(descriptor)
    return np.frombuffer(mapped, np.dtype(shared.dtype)).reshape(shared.shape)


def new_arrays(
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]],
) -> dict[str, NDArray[Any]]:
    """Returns arrays of these shapes and dtypes to be filled, whose content is arbitrary.

    Together they have at most `MEMORY_BYTES` in memory, or else lie in the folder of the cache, or
    in that of temporary files where the cache cannot be written to.

    Raises:
        DiskFullError: no space is left.
    """
    sizes = {name: int(np.prod(shape)) * dtype.itemsize for name, (shape, dtype) in kinds.items()}
    place = _in_memory if sum(sizes.values()) <= MEMORY_BYTES else _in_file
    return {
        name: place(sizes[name]).view(dtype).reshape(shape)
        if sizes[name]
        else np.empty(shape, dtype)
        for name, (shape, dtype) in kinds.items()
    }


def _in_memory(n_bytes: int) -> NDArray[np.uint8]:
    """Bytes in memory, where the system can in a file that other processes can map."""
    if sys.platform != "linux":
        return np.empty(n_bytes, dtype=np.uint8)
    descriptor = os.memfd_create("swarmdata")
    try:
        os.ftruncate(descriptor, n_bytes)
        return np.frombuffer(ScratchMap(descriptor, n_bytes), dtype=np.uint8)
    finally:
        os.close(descriptor)


def _in_file(n_bytes: int) -> NDArray[np.uint8]:
    """Bytes of a new file, which has its space on the disk before any of it is written to."""
    folder = _folder()
    with disk_full_explained(folder), tempfile.TemporaryFile(dir=folder) as file:
        if hasattr(os, "posix_fallocate"):  # not on macOS
            os.posix_fallocate(file.fileno(), 0, n_bytes)
        else:
            for _ in range(0, n_bytes, 1 << 20):
                file.write(bytes(1 << 20))
            file.flush()
        return np.frombuffer(ScratchMap(file.fileno(), n_bytes), dtype=np.uint8)


def _folder() -> Path:
    cache = cache_folder()
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError:  # of a cache that can only be read
        return Path(tempfile.gettempdir())
    return cache if os.access(cache, os.W_OK) else Path(tempfile.gettempdir())
