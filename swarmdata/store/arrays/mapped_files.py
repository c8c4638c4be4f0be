"""Maps the files of an array into memory, several of them one after the other, as one array."""

import ctypes
import errno
import mmap
import os
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from swarmdata.store.arrays.layout import ArrayPlan

MAP_FIXED = 0x10
"""Flag of mmap(2) on Linux, macOS and the BSDs, which Python's `mmap` does not name."""


def map_array(path: Path, plan: ArrayPlan) -> tuple[NDArray[np.uint8], tuple[bytes, ...]]:
    """Maps the chunks of an array, whose files have the sizes of its plan.

    Returns:
        All chunks, one after the other and read-only, and the shard index of each file.

    Raises:
        OSError: a file cannot be read, or the process has too few addresses left for it.
    """
    try:
        return _mapped(path, plan)
    except OSError as error:
        if error.errno != errno.ENOMEM:
            raise
        reason = (
            f"{plan.shard.nbytes / 1e6:.0f} MB cannot be mapped into memory. That takes addresses, "
            "not memory; raise their limit (`ulimit -v unlimited`) or use a smaller dataset"
        )
        raise OSError(error.errno, reason, str(path / plan.files[0])) from error


def _mapped(path: Path, plan: ArrayPlan) -> tuple[NDArray[np.uint8], tuple[bytes, ...]]:
    shard, files, *_ = plan
    if not files:
        return np.zeros(0, dtype=np.uint8), ()
    if len(files) == 1:
        with open(os.path.join(path, files[0]), "rb") as file:  # noqa: PTH118, PTH123 (a part of every load)
            whole = np.frombuffer(
                mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), dtype=np.uint8
            )
        return whole[: shard.data_bytes], (whole[shard.data_bytes :].tobytes(),)
    opened = [(path / name).open("rb") for name in files]
    try:
        sizes = [shard.data_of(k) for k in range(len(files))]
        indices = tuple(
            os.pread(file.fileno(), shard.file_bytes(k) - size, size)
            for k, (file, size) in enumerate(zip(opened, sizes, strict=True))
        )
        return _joined(opened, sizes), indices
    finally:
        for file in opened:
            file.close()


def _joined(files: Sequence[BinaryIO], sizes: Sequence[int]) -> NDArray[np.uint8]:
    """Maps the beginnings of files one after the other: all but the last fill whole pages."""
    # holds the range of addresses, over which files are mapped; its end unmaps all of them
    held = mmap.mmap(
        -1, sum(sizes), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ
    )
    values = np.frombuffer(held, dtype=np.uint8)
    address = values.__array_interface__["data"][0]
    for file, size in zip(files, sizes, strict=True):
        if size and address % mmap.PAGESIZE:
            raise OSError(
                f"{file.name} cannot be mapped after the file before it, which does not fill whole "
                f"pages of {mmap.PAGESIZE} bytes."
            )
        flags = mmap.MAP_SHARED | MAP_FIXED
        found = _mmap(address, size, mmap.PROT_READ, flags, file.fileno(), 0)
        if found != address:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), file.name)
        address += size
    return values


def _mmap(*arguments: int) -> int | None:
    """The C library's mmap(2): address, length, protection, flags, file and offset."""
    function = ctypes.CDLL(None, use_errno=True).mmap
    function.restype = ctypes.c_void_p
    function.argtypes = (
        ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long,
    )  # fmt: skip
    address: int | None = function(*arguments)
    return address
