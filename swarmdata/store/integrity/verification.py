"""The slow checks of a stored dataset: every byte of every file, and the logical digest."""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ChecksumError
from swarmdata.runtime.mapped_pages import release_pages
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import Manifest, file_changed, logical_header, repair_hint

BLOCK_BYTES = 16 << 20
"""Bytes that are hashed together."""

Raw = Mapping[str, NDArray[np.uint8]]
"""The chunks of each array, one after the other, by array name."""


def check_everything(path: Path, manifest: Manifest, raw: Raw) -> None:
    """Checks the SHA-256 of every file, and the logical digest of all arrays.

    Raises:
        ChecksumError: naming the file, or the digests.
    """
    for name in sorted(manifest.files):
        if file_digest(path / name) != manifest.files[name].sha256:
            raise file_changed(path, name)
    digest = logical_digest(manifest, raw)
    if digest != manifest.digest:
        raise ChecksumError(
            f"the arrays of {path} have the logical digest {digest}, the manifest says "
            f"{manifest.digest}. {repair_hint(path)}"
        )


def logical_digest(manifest: Manifest, raw: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over header and C-order bytes of each array in sorted name order, hex."""
    logical = hashlib.sha256()
    for name in sorted(manifest.arrays):
        entry = manifest.arrays[name]
        logical.update(logical_header(name, entry.dtype, entry.shape))
        for block in byte_blocks(raw[name][: manifest.plan[name].shard.nbytes]):
            logical.update(block.data)
    return logical.hexdigest()


def byte_blocks(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yields consecutive blocks of bytes, and gives the pages of each back."""
    for first in range(0, len(values), BLOCK_BYTES):
        block = values[first : first + BLOCK_BYTES]
        yield block
        release_pages(block)
