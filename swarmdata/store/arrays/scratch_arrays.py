"""Arrays that are computed and kept: small ones in memory, large ones in files without a name."""

import mmap
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.runtime.atomic import disk_full_explained
from swarmdata.store.cache import cache_folder

MEMORY_BYTES = 256 << 20
"""Most bytes of arrays that are kept in memory; more are in files."""


class ScratchMap(mmap.mmap):
    """A map of a file that has no name: it goes with the last array that is a view of it."""


def new_arrays(
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]],
) -> dict[str, NDArray[Any]]:
    """Returns arrays to be filled, whose content is arbitrary.

    Together they have at most `MEMORY_BYTES` in memory, or else lie in the folder of the cache, or
    in that of temporary files where the cache cannot be written to.

    Args:
        kinds: shape and dtype by name.

    Raises:
        DiskFullError: no space is left.
    """
    sizes = {name: int(np.prod(shape)) * dtype.itemsize for name, (shape, dtype) in kinds.items()}
    if sum(sizes.values()) <= MEMORY_BYTES:
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in kinds.items()}
    return {
        name: _mapped(sizes[name]).view(dtype).reshape(shape)
        for name, (shape, dtype) in kinds.items()
    }


def _mapped(n_bytes: int) -> NDArray[np.uint8]:
    """Bytes of a new file, which has its space on the disk before any of it is written to."""
    if not n_bytes:
        return np.empty(0, dtype=np.uint8)
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
