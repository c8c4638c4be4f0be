"""Recomputes the manifest of a dataset from all its other files.

It lists the files as they are, damaged or not. So it may be used only after its digests have
been found equal to known ones.
"""

import json
from collections.abc import Mapping
from pathlib import Path

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
    Shard,
    expected_files,
    format_version,
    metadata_file,
    plan_shard,
)
from swarmdata.store.arrays.mapped_files import map_array
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.store.arrays.shards import array_entry, file_digest
from swarmdata.store.damage import logical_digest
from swarmdata.store.manifest import FileEntry, Manifest, StatisticsEntry
from swarmdata.store.stored_dataset import StoredDataset, typed_arrays
from swarmdata.store.table import SPLITS, EpisodeTable

UNKNOWN = "0" * 64
"""Stands for a digest until it is computed."""


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
        return _remade(path, recipe, dict(provenance))
    except (OSError, ValueError, IndexError, RecursionError) as error:
        raise ManifestError(f"no manifest can be made for {path}: {error}") from error


def _remade(path: Path, recipe: Recipe, provenance: dict[str, str]) -> Manifest:
    optional = [name for name in OPTIONAL_FIELDS if (path / metadata_file(name)).exists()]
    shards = {name: _shard(path, name) for name in sorted([*FIELDS, *optional])}
    networks = {f"{CHECKPOINTS}/{each.checkpoint}" for each in recipe.policies if each.checkpoint}
    kept = sorted(file for file in networks if (path / file).is_file())
    draft = Manifest(
        format_version=format_version(shards.values()),
        id=recipe.id,
        recipe_hash=recipe.hash(),
        n_episodes=shards["episodes/lengths"].shape[0],
        n_steps=shards["actions"].shape[0],
        digest=UNKNOWN,
        arrays={name: array_entry(shard, ()) for name, shard in shards.items()},
        files={
            name: FileEntry(size=(path / name).stat().st_size, sha256=file_digest(path / name))
            for name in (*expected_files(shards), *kept)
        },
        statistics=StatisticsEntry(
            observation_mean=(), observation_std=(), reward_mean=0.0, reward_std=0.0
        ),
        provenance=provenance,
    )
    for shard, files, *_ in draft.plan.values():
        for index, file in enumerate(files):
            if draft.files[file].size != shard.file_bytes(index):
                raise DatasetError(f"{path / file} has another size than its metadata ask for")
    raw = {name: map_array(path, plan)[0] for name, plan in draft.plan.items()}
    found = {
        "digest": logical_digest(draft, raw),
        "arrays": {name: array_entry(s, _checksums(s, raw[name])) for name, s in shards.items()},
        "statistics": _statistics(path, draft, recipe, raw),
    }
    return draft.model_copy(update=found)


def _shard(path: Path, name: str) -> Shard:
    """The byte layout that an array's Zarr metadata and its dtype give; the digest vouches."""
    metadata = json.loads((path / metadata_file(name)).read_bytes())
    field = ALL_FIELDS[name]
    shape = metadata.get("shape") if isinstance(metadata, dict) else None
    is_shape = isinstance(shape, list) and all(isinstance(n, int) and n >= 0 for n in shape)
    if shape is None or not is_shape or len(shape) != len(field.dimensions):
        raise DatasetError(f"{metadata_file(name)} has shape {shape}")
    return plan_shard(field.dtype_in(metadata), tuple(shape))


def _checksums(shard: Shard, raw: NDArray[np.uint8]) -> tuple[str, ...]:
    size, checksums = shard.chunk_bytes, []
    for k in range(shard.n_chunks):
        chunk = raw[k * size : (k + 1) * size]
        checksums.append(xxhash.xxh3_64_hexdigest(chunk.data))
        release_pages(chunk)
    return tuple(checksums)


def _statistics(
    path: Path, manifest: Manifest, recipe: Recipe, raw: Mapping[str, NDArray[np.uint8]]
) -> StatisticsEntry:
    """Moments of the train split, summed episode by episode as when the dataset was written."""
    arrays = typed_arrays(manifest, raw)
    columns = {name.partition("/")[2]: arrays[name] for name in FIELDS if "/" in name}
    table = EpisodeTable(**columns)
    stored = StoredDataset(path, manifest, recipe, arrays, table)
    observations, rewards = Moments(), Moments()
    reads = MappedReads(raw.values())
    for number in np.flatnonzero(table.split == SPLITS.index("train")).tolist():
        seen = stored.rows(number, "observations")
        observations.add(seen.reshape(-1, seen.shape[2]))
        rewards.add(stored.rows(number, "rewards").reshape(-1, 1))
        reads.add(seen)
    mean, std = observations.result()
    (reward_mean,), (reward_std,) = rewards.result()
    return StatisticsEntry(
        observation_mean=mean, observation_std=std, reward_mean=reward_mean, reward_std=reward_std
    )
