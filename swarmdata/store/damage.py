"""The slow checks of a stored dataset, which read every byte, and the damage that they find."""

import hashlib
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import ChecksumError, DatasetError, DatasetNotFoundError, FormatVersionError
from swarmdata.runtime.mapped_pages import release_pages
from swarmdata.store.arrays.layout import MANIFEST, array_files
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import (
    ArrayEntry,
    Manifest,
    file_changed,
    logical_header,
    read_manifest,
    repair_hint,
    without_hint,
)
from swarmdata.store.recognition import is_dataset, no_dataset, no_folder
from swarmdata.store.stored_dataset import blocking_links, check_listing, map_checked, open_store

BLOCK_BYTES = 16 << 20  # bytes that are hashed together


@dataclass(frozen=True, slots=True)
class Damage:
    """One broken file.

    Of an array's file, the first bad chunk is named where one is; a damaged shard index is no
    chunk's.
    """

    file: str  # relative to the dataset's folder
    problem: str  # in words
    array: str | None = None
    chunk: int | None = None  # the first bad one
    rows: tuple[int, int] | None = None  # of that chunk, both included

    def __str__(self) -> str:
        return f"{self.file}: {self.problem}"


def find_damage(path: Path) -> tuple[Damage, ...]:
    """Reads every byte of a dataset and lists every broken file, in the order of their names.

    Without a sound manifest there is nothing to hold the other files against, so only the manifest
    is listed. The card is in no digest and is not looked at.

    Raises:
        DatasetNotFoundError: there is no such folder, or it is no dataset.
        FormatVersionError: written by a newer version; that is no damage.
    """
    if not path.is_dir():
        raise DatasetNotFoundError(no_folder(path))
    if not is_dataset(path):
        raise DatasetNotFoundError(no_dataset(path))
    links = set(blocking_links(path))
    damage = [Damage(link, "is a symbolic link, expected a plain file or folder") for link in links]
    if MANIFEST not in links:
        damage += _contents(path, links)
    return tuple(sorted(damage, key=lambda each: each.file))


def _contents(path: Path, links: set[str]) -> list[Damage]:
    """The damage of the manifest or, if it is sound, of the files that it lists."""
    try:
        manifest = read_manifest(path)
        check_listing(path, manifest)
    except FormatVersionError:
        raise
    except DatasetError as error:
        return [Damage(MANIFEST, without_hint(str(error), path))]
    # links, and what is in linked folders, is not read
    plain = [
        f for f in sorted(manifest.files) if not any(map(PurePosixPath(f).is_relative_to, links))
    ]
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        found = pool.map(lambda file: _of_file(path, manifest, file), plain)
        damage = [each for each in found if each is not None]
    return damage if damage or links else _contradictions(path, manifest)


def _of_file(path: Path, manifest: Manifest, file: str) -> Damage | None:
    expected, target = manifest.files[file], path / file
    try:
        if not target.is_file():
            return Damage(file, "is absent")
        size = target.stat().st_size
        if size == expected.size and file_digest(target) == expected.sha256:
            return None
        cut = "" if size == expected.size else f"has {size:,} bytes, expected {expected.size:,}"
        for name, plan in manifest.plan.items():
            if file in plan.files:
                return _of_array(target, file, name, manifest.arrays[name], cut)
        return Damage(file, cut or "was changed: its SHA-256 is not the one in the manifest")
    except OSError as error:  # such as a bad sector: the file is lost, the others are looked at
        return Damage(file, f"cannot be read: {error.strerror or error}")


def _of_array(target: Path, file: str, name: str, entry: ArrayEntry, cut: str) -> Damage:
    """Finds the bad chunks of an array's file that does not have its SHA-256."""
    shard = entry.shard
    chunks = shard.chunks_of(array_files(name, shard).index(file))
    bad = _bad_chunks(target, entry, chunks)
    if not bad:
        return Damage(file, cut or "was changed in the shard index at its end", name)
    first = bad[0]
    rows = shard.rows_of(first)
    problem = (
        f"{cut or 'was changed'}: {len(bad)} of {len(chunks)} chunks are bad, the first "
        f"is chunk {first} (rows {rows[0]} to {rows[1]} of {name!r})"
    )
    return Damage(file, problem, name, first, rows)


def _bad_chunks(target: Path, entry: ArrayEntry, chunks: range) -> list[int]:
    """Those of a file's chunks that do not have their checksums; one in memory at a time."""
    size = entry.shard.chunk_bytes
    with target.open("rb") as stream:
        return [
            index
            for index in chunks
            if xxhash.xxh3_64_hexdigest(stream.read(size)) != entry.checksums[index]
        ]


def _contradictions(path: Path, manifest: Manifest) -> list[Damage]:
    """Sound files that contradict each other, as only whoever signs a manifest can make them."""
    try:
        open_store(path, "none", widths=True)
    except DatasetError as error:
        return [Damage(MANIFEST, without_hint(str(error), path))]
    raw = {name: map_checked(path, manifest, name) for name in manifest.arrays}
    digest = logical_digest(manifest, raw)
    if digest != manifest.digest:
        problem = f"says the logical digest {manifest.digest}, the arrays have {digest}"
        return [Damage(MANIFEST, problem)]
    return []


def check_everything(path: Path, manifest: Manifest, raw: Mapping[str, NDArray[np.uint8]]) -> None:
    """Checks the SHA-256 of every file, and the logical digest of all arrays (ChecksumError)."""
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
        values = raw[name][: manifest.plan[name].shard.nbytes]
        for first in range(0, len(values), BLOCK_BYTES):
            block = values[first : first + BLOCK_BYTES]
            logical.update(block.data)
            release_pages(block)
    return logical.hexdigest()
