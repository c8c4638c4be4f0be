"""Writes arrays of any size as Zarr shards, one chunk in memory at a time, hashing on the way."""

import hashlib
import json
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.store.arrays.layout import (
    ALL_FIELDS,
    GROUP_FILES,
    Shard,
    array_files,
    expected_metadata,
    metadata_file,
)
from swarmdata.store.manifest import ArrayEntry, logical_header


def create_metadata(
    folder: Path,
    shards: Mapping[str, Shard],
    attributes: dict[str, Any],
    of_arrays: Mapping[str, dict[str, Any]],
) -> None:
    """Writes the metadata of both groups and all arrays as zarr-python does, and no data.

    `attributes` are those of the root group, `of_arrays` those of each array.
    """
    group = {"zarr_format": 3, "node_type": "group"}
    root, episodes = GROUP_FILES
    documents: dict[str, dict[str, Any]] = {
        root: {"attributes": attributes, **group},
        episodes: {"attributes": {}, **group},
    }
    for name, shard in shards.items():
        layout = expected_metadata(shard)
        kind = {key: layout.pop(key) for key in group}
        documents[metadata_file(name)] = {
            **layout,
            "attributes": of_arrays[name],
            "dimension_names": list(ALL_FIELDS[name].dimensions),
            **kind,
            "storage_transformers": [],
        }
    for file, document in documents.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(json.dumps(document, indent=2).encode())


def write_shard(
    folder: Path, name: str, shard: Shard, blocks: Iterable[NDArray[Any]], logical: "hashlib._Hash"
) -> ArrayEntry:
    """Streams rows into the array's files, below a folder with its metadata.

    The blocks are consecutive rows, together exactly the array; `logical`, the running logical
    digest, takes the header and the rows.

    Raises:
        SchemaError: the blocks have another dtype, row shape or number of rows.
    """
    logical.update(logical_header(name, shard.dtype, shard.shape))
    checksums = []
    left = shard.nbytes
    chunks = _chunks(_checked(name, shard, blocks), shard.chunk_bytes)
    for index, path in enumerate(array_files(name, shard)):
        with (folder / path).open("wb") as file:
            for chunk in islice(chunks, len(shard.chunks_of(index))):
                logical.update(chunk[: min(left, len(chunk))].data)
                left -= min(left, len(chunk))
                checksums.append(xxhash.xxh3_64_hexdigest(chunk.data))
                file.write(chunk.data)
            file.write(shard.index_of(index))
    if shard.n_chunks:
        deque(chunks, maxlen=0)  # to the end of the blocks, where the number of rows is compared
    return array_entry(shard, tuple(checksums))


def array_entry(shard: Shard, checksums: tuple[str, ...]) -> ArrayEntry:
    """What a manifest says of an array."""
    return ArrayEntry(
        dtype=shard.dtype,
        shape=shard.shape,
        chunk_rows=shard.chunk_rows,
        shard_rows=shard.shard_rows,
        checksums=checksums,
    )


def _checked(
    name: str, shard: Shard, blocks: Iterable[NDArray[Any]]
) -> Iterator[NDArray[np.uint8]]:
    """Yields the bytes of each block."""
    rows, dtype = 0, np.dtype(shard.dtype)
    for block in blocks:
        if block.dtype != dtype or block.shape[1:] != shard.shape[1:]:
            raise SchemaError(
                f"array {name!r} got rows of dtype {block.dtype} and shape {block.shape[1:]}, "
                f"expected {shard.dtype} and {shard.shape[1:]}"
            )
        rows += len(block)
        yield np.ascontiguousarray(block).reshape(-1).view(np.uint8)
    if rows != shard.shape[0]:
        raise SchemaError(f"array {name!r} got {rows} rows, expected {shard.shape[0]}")


def _chunks(blocks: Iterable[NDArray[np.uint8]], size: int) -> Iterator[NDArray[np.uint8]]:
    """Cuts a stream of bytes into chunks of `size`, the last padded with zeros; all one buffer."""
    buffer = np.zeros(size, dtype=np.uint8)
    used = 0
    for block in blocks:
        position = 0
        while position < len(block):
            n = min(size - used, len(block) - position)
            buffer[used : used + n] = block[position : position + n]
            used, position = used + n, position + n
            if used == size:
                yield buffer
                used = 0
    if used:
        buffer[used:] = 0
        yield buffer


def file_digest(path: Path) -> str:
    """SHA-256 of a file, hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
