"""Makes the manifest of a dataset whose manifest was lost, from all its other files.

It lists the files as they are, damaged or not. So it may be used only after its digests have
been found equal to known ones.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from swarmdata.errors import DatasetError, ManifestError
from swarmdata.specs.recipe import Recipe
from swarmdata.store.arrays.layout import (
    ALL_FIELDS,
    CHECKPOINTS,
    FIELDS,
    FORMAT_VERSION,
    OPTIONAL_FIELDS,
    Shard,
    array_file,
    expected_files,
    expected_metadata,
    metadata_file,
    plan_shard,
)
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.manifest import (
    ArrayEntry,
    FileEntry,
    Manifest,
    StatisticsEntry,
    logical_header,
)
from swarmdata.store.table import SPLITS


def remake_manifest(path: Path, recipe: Recipe, provenance: Mapping[str, str]) -> Manifest:
    """Lists the files of a dataset's folder as if they had just been written.

    Where nothing but the manifest was damaged, this is the manifest that was lost, bit for bit, if
    the provenance is.

    Args:
        path: the dataset's folder.
        recipe: what the dataset was made from.
        provenance: versions and platform that it was made with.

    Raises:
        DatasetError: the files cannot be those of a dataset.
    """
    try:
        optional = [name for name in OPTIONAL_FIELDS if (path / metadata_file(name)).exists()]
        shards = {name: _shard(path, name) for name in sorted([*FIELDS, *optional])}
        raw = {name: _read(path, name, shard) for name, shard in shards.items()}
        files = {
            name: FileEntry(size=(path / name).stat().st_size, sha256=file_digest(path / name))
            for name in (*expected_files(shards), *_checkpoints(path, recipe))
        }
    except (OSError, ValueError, RecursionError) as error:
        raise ManifestError(f"no manifest can be made for {path}: {error}") from error
    lengths = _values(raw, shards, "episodes/lengths")
    return Manifest(
        format_version=FORMAT_VERSION,
        id=recipe.id,
        recipe_hash=recipe.hash(),
        n_episodes=len(lengths),
        n_steps=shards["actions"].shape[0],
        digest=_digest(raw, shards),
        arrays={name: _entry(shard, raw[name]) for name, shard in shards.items()},
        files=files,
        statistics=_statistics(raw, shards),
        provenance=dict(provenance),
    )


def _checkpoints(path: Path, recipe: Recipe) -> list[str]:
    """The recipe's networks that are in the dataset's folder."""
    named = {f"{CHECKPOINTS}/{each.checkpoint}" for each in recipe.policies if each.checkpoint}
    return sorted(file for file in named if (path / file).is_file())


def _shard(path: Path, name: str) -> Shard:
    """The byte layout that an array's Zarr metadata and its dtype give."""
    metadata = json.loads((path / metadata_file(name)).read_bytes())
    field = ALL_FIELDS[name]
    shape = metadata.get("shape") if isinstance(metadata, dict) else None
    is_shape = isinstance(shape, list) and all(isinstance(n, int) and n >= 0 for n in shape)
    if shape is None or not is_shape or len(shape) != len(field.dimensions):
        raise DatasetError(f"{metadata_file(name)} has shape {shape}")
    shard = plan_shard(field.dtype, tuple(shape))
    for key, expected in expected_metadata(shard).items():
        if metadata.get(key) != expected:
            raise DatasetError(f"{metadata_file(name)} has {key} {metadata.get(key)}")
    return shard


def _read(path: Path, name: str, shard: Shard) -> NDArray[np.uint8]:
    """Maps an array's file, if it has the size of the array."""
    if not shard.n_chunks:
        return np.zeros(0, dtype=np.uint8)
    file = path / array_file(name, len(shard.shape))
    size = file.stat().st_size
    if size != shard.file_bytes:
        raise DatasetError(f"{file} has {size} bytes, its metadata ask for {shard.file_bytes}")
    return np.asarray(np.memmap(file, dtype=np.uint8, mode="r"))


Raw = Mapping[str, NDArray[np.uint8]]
Shards = Mapping[str, Shard]


def _values(raw: Raw, shards: Shards, name: str) -> NDArray[Any]:
    shard = shards[name]
    return raw[name][: shard.nbytes].view(np.dtype(shard.dtype)).reshape(shard.shape)


def _digest(raw: Raw, shards: Shards) -> str:
    logical = hashlib.sha256()
    for name, shard in shards.items():
        logical.update(logical_header(name, shard.dtype, shard.shape))
        logical.update(raw[name][: shard.nbytes].data)
    return logical.hexdigest()


def _entry(shard: Shard, raw: NDArray[np.uint8]) -> ArrayEntry:
    size = shard.chunk_bytes
    chunks = (raw[k * size : (k + 1) * size] for k in range(shard.n_chunks))
    return ArrayEntry(
        dtype=shard.dtype,
        shape=shard.shape,
        chunk_rows=shard.chunk_rows,
        checksums=tuple(xxhash.xxh3_64_hexdigest(chunk.data) for chunk in chunks),
    )


def _statistics(raw: Raw, shards: Shards) -> StatisticsEntry:
    """Moments of the train split, summed episode by episode as when the dataset was written."""
    observations, rewards = Moments(), Moments()
    for steps, states in _train_rows(raw, shards):
        seen = _values(raw, shards, "observations")[states]
        observations.add(seen.reshape(-1, seen.shape[2]))
        rewards.add(_values(raw, shards, "rewards")[steps].reshape(-1, 1))
    if not observations.count:
        raise ManifestError("no episode is in the train split")
    mean, std = observations.result()
    (reward_mean,), (reward_std,) = rewards.result()
    return StatisticsEntry(
        observation_mean=mean, observation_std=std, reward_mean=reward_mean, reward_std=reward_std
    )


def _train_rows(raw: Raw, shards: Shards) -> Iterator[tuple[slice, slice]]:
    """Rows of each train episode in the arrays with T and with T + 1 rows per episode."""
    columns = ("episodes/starts", "episodes/lengths", "episodes/split")
    table = zip(*(_values(raw, shards, name).tolist() for name in columns), strict=True)
    for index, (start, length, split) in enumerate(table):
        if not 0 <= start <= start + length <= shards["rewards"].shape[0]:
            raise ManifestError(f"episode {index} is outside of the arrays")
        if split == SPLITS.index("train"):
            first = start + index
            yield slice(start, start + length), slice(first, first + length + 1)
