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
from swarmdata.runtime.mapped_pages import MappedReads, release_pages
from swarmdata.specs.recipe import Recipe
from swarmdata.store.arrays.layout import (
    ALL_FIELDS,
    CHECKPOINTS,
    FIELDS,
    OPTIONAL_FIELDS,
    ArrayPlan,
    Shard,
    array_files,
    expected_files,
    expected_metadata,
    format_version,
    metadata_file,
    plan_shard,
)
from swarmdata.store.arrays.mapped_files import map_array
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.damage import byte_blocks
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
        format_version=format_version(shards.values()),
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
    shard = plan_shard(field.dtype_in(metadata), tuple(shape))
    for key, expected in expected_metadata(shard).items():
        if metadata.get(key) != expected:
            raise DatasetError(f"{metadata_file(name)} has {key} {metadata.get(key)}")
    return shard


def _read(path: Path, name: str, shard: Shard) -> NDArray[np.uint8]:
    """Maps an array's files, if they have the sizes of the array."""
    plan = ArrayPlan(shard, array_files(name, shard), metadata_file(name), {})
    for index, file in enumerate(plan.files):
        size, expected = (path / file).stat().st_size, shard.file_bytes(index)
        if size != expected:
            raise DatasetError(f"{path / file} has {size} bytes, its metadata ask for {expected}")
    values, _ = map_array(path, plan)
    return values


Raw = Mapping[str, NDArray[np.uint8]]
Shards = Mapping[str, Shard]


def _values(raw: Raw, shards: Shards, name: str) -> NDArray[Any]:
    shard = shards[name]
    return raw[name][: shard.nbytes].view(np.dtype(shard.dtype)).reshape(shard.shape)


def _digest(raw: Raw, shards: Shards) -> str:
    logical = hashlib.sha256()
    for name, shard in shards.items():
        logical.update(logical_header(name, shard.dtype, shard.shape))
        for block in byte_blocks(raw[name][: shard.nbytes]):
            logical.update(block.data)
    return logical.hexdigest()


def _entry(shard: Shard, raw: NDArray[np.uint8]) -> ArrayEntry:
    size = shard.chunk_bytes
    checksums = []
    for k in range(shard.n_chunks):
        chunk = raw[k * size : (k + 1) * size]
        checksums.append(xxhash.xxh3_64_hexdigest(chunk.data))
        release_pages(chunk)
    return ArrayEntry(
        dtype=shard.dtype,
        shape=shard.shape,
        chunk_rows=shard.chunk_rows,
        shard_rows=shard.shard_rows,
        checksums=tuple(checksums),
    )


def _statistics(raw: Raw, shards: Shards) -> StatisticsEntry:
    """Moments of the train split, summed episode by episode as when the dataset was written."""
    observations, rewards = Moments(), Moments()
    reads = MappedReads(raw.values())
    for steps, states in _train_rows(raw, shards):
        seen = _values(raw, shards, "observations")[states]
        observations.add(seen.reshape(-1, seen.shape[2]))
        rewards.add(_values(raw, shards, "rewards")[steps].reshape(-1, 1))
        reads.add(seen)
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
