"""Checksums of a stored dataset: every chunk at memory speed, or every byte of every file."""

import hashlib
import mmap
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import ChecksumError
from swarmdata.store.arrays.layout import array_file
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import Manifest, logical_header, rebuild_hint

Raw = Mapping[str, NDArray[np.uint8]]
"""The bytes of each array's file, by array name."""


def map_shard(path: Path, manifest: Manifest, name: str) -> NDArray[np.uint8]:
    """Maps the array's whole file, index included; empty for an array without elements."""
    shard = manifest.arrays[name].shard
    if not shard.n_chunks:
        return np.zeros(0, dtype=np.uint8)
    with (path / array_file(name, len(shard.shape))).open("rb") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(mapped, dtype=np.uint8)


def check_small_files(path: Path, manifest: Manifest) -> None:
    """Checks the SHA-256 of every file that is not an array's data."""
    large = {array_file(name, len(entry.shape)) for name, entry in manifest.arrays.items()}
    _check_files(path, manifest, sorted(set(manifest.files) - large))


def _check_files(path: Path, manifest: Manifest, names: list[str]) -> None:
    for name in names:
        if file_digest(path / name) != manifest.files[name].sha256:
            raise ChecksumError(
                f"{path / name} was changed after it was written: its SHA-256 is not the one in "
                f"the manifest. {rebuild_hint(path, manifest.id)}"
            )


def check_chunks(path: Path, manifest: Manifest, raw: Raw) -> None:
    """Checks the xxh3_64 of every chunk, in as many threads as there are cores.

    Raises:
        ChecksumError: naming the file, the first changed chunk and its rows.
    """
    jobs = [
        (name, index, checksum)
        for name, entry in manifest.arrays.items()
        for index, checksum in enumerate(entry.checksums)
    ]

    def is_intact(job: tuple[str, int, str]) -> bool:
        name, index, checksum = job
        size = manifest.arrays[name].shard.chunk_bytes
        chunk = raw[name][index * size : (index + 1) * size]
        return xxhash.xxh3_64_hexdigest(chunk.data) == checksum

    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        for job, intact in zip(jobs, pool.map(is_intact, jobs), strict=True):
            if not intact:
                raise _changed(path, manifest, *job[:2])


def _changed(path: Path, manifest: Manifest, name: str, index: int) -> ChecksumError:
    entry = manifest.arrays[name]
    first = index * entry.chunk_rows
    last = min(first + entry.chunk_rows, entry.shape[0]) - 1
    return ChecksumError(
        f"{path / array_file(name, len(entry.shape))} was changed after it was written: chunk "
        f"{index} of {entry.shard.n_chunks} (rows {first} to {last} of {name!r}) does not have "
        f"the checksum in the manifest. {rebuild_hint(path, manifest.id)}"
    )


def check_everything(path: Path, manifest: Manifest, raw: Raw) -> None:
    """Checks the SHA-256 of every file, and the logical digest of all arrays.

    Raises:
        ChecksumError: naming the file, or the digests.
    """
    _check_files(path, manifest, sorted(manifest.files))
    digest = logical_digest(manifest, raw)
    if digest != manifest.digest:
        raise ChecksumError(
            f"the arrays of {path} have the logical digest {digest}, the manifest says "
            f"{manifest.digest}. {rebuild_hint(path, manifest.id)}"
        )


def logical_digest(manifest: Manifest, raw: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over header and C-order bytes of each array in sorted name order, hex."""
    logical = hashlib.sha256()
    for name in sorted(manifest.arrays):
        entry = manifest.arrays[name]
        logical.update(logical_header(name, entry.dtype, entry.shape))
        logical.update(raw[name][: entry.shard.nbytes].data)
    return logical.hexdigest()
