"""The slow checks of a stored dataset: every byte of every file, and the logical digest."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import ChecksumError
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import Manifest, logical_header, rebuild_hint

Raw = Mapping[str, NDArray[np.uint8]]
"""The bytes of each array's file, by array name."""


def check_everything(path: Path, manifest: Manifest, raw: Raw) -> None:
    """Checks the SHA-256 of every file, and the logical digest of all arrays.

    Raises:
        ChecksumError: naming the file, or the digests.
    """
    for name in sorted(manifest.files):
        if file_digest(path / name) != manifest.files[name].sha256:
            raise file_changed(path, manifest, name)
    digest = logical_digest(manifest, raw)
    if digest != manifest.digest:
        raise ChecksumError(
            f"the arrays of {path} have the logical digest {digest}, the manifest says "
            f"{manifest.digest}. {rebuild_hint(path, manifest.id)}"
        )


def file_changed(path: Path, manifest: Manifest, name: str) -> ChecksumError:
    """The error that a file does not have its SHA-256."""
    return ChecksumError(
        f"{path / name} was changed after it was written: its SHA-256 is not the one in the "
        f"manifest. {rebuild_hint(path, manifest.id)}"
    )


def logical_digest(manifest: Manifest, raw: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over header and C-order bytes of each array in sorted name order, hex."""
    logical = hashlib.sha256()
    for name in sorted(manifest.arrays):
        entry = manifest.arrays[name]
        logical.update(logical_header(name, entry.dtype, entry.shape))
        logical.update(raw[name][: manifest.plan[name].shard.nbytes].data)
    return logical.hexdigest()
