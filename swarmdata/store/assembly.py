"""Assembles parts into a finished dataset, published in one rename."""

import hashlib
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from swarmdata.errors import BuildError, DatasetError, SchemaError
from swarmdata.runtime.atomic import is_vacant, new_folder
from swarmdata.runtime.own_components import code_of, package_of
from swarmdata.specs.origins import Origin
from swarmdata.specs.recipe import PolicySource, who_acts
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import (
    ALL_FIELDS,
    CHECKPOINTS,
    FIELDS,
    MANIFEST,
    RECIPE,
    TIME_FIELDS,
    DType,
    Shard,
    common_dtype,
    expected_files,
    format_version,
    plan_shard,
)
from swarmdata.store.arrays.running_moments import RunningMoments, present_rows
from swarmdata.store.arrays.shards import create_metadata, file_digest, write_shard
from swarmdata.store.manifest import (
    FileEntry,
    MadeFrom,
    Manifest,
    StatisticsEntry,
    check_recipe,
    read_manifest,
)
from swarmdata.store.parts import (
    episode_slices,
    optional_fields,
    part_dtype,
    read_part_layouts,
    read_part_table,
)
from swarmdata.store.split_rule import assign_splits
from swarmdata.store.table import SPLITS, EpisodeTable
from swarmdata.types import END_REASONS, EVENTS, TASK_END_REASONS, Bool, Counts

Parts = Mapping[int, Sequence[Path]]
Order = Sequence[tuple[int, int]]


def assemble(
    out: Path,
    *,
    recipe: Origin,
    parts: Parts,
    order: Order,
    splits: Counts | None = None,
    optional: Sequence[str] | None = None,
    checkpoints: Mapping[str, bytes] = MappingProxyType({}),
    consume: bool = False,
    progress: bool = False,
) -> Manifest:
    """Writes the finished dataset folder, manifest last, and publishes it in one rename.

    Memory stays bounded by one chunk of the widest array and one part. Where `out` already is a
    finished dataset of the same recipe, it is kept and its manifest returned; it is not verified.

    Args:
        out: where the dataset appears.
        recipe: of the dataset.
        parts: consecutive parts of each policy's stream, by policy index.
        order: the episodes as (policy index, index in that policy's stream), each stream in
            increasing order; see `merge_order`.
        splits: index into `SPLITS` of each episode; None for those of the recipe's rule.
        optional: optional arrays of the parts to take; None for all that they have.
        checkpoints: content of the networks to keep with the dataset, by file name.
        consume: whether files of parts are deleted as soon as they are copied. Where that is
            interrupted, the parts that are `is_consumed` have to be made again.
        progress: whether to show a bar over the arrays.

    Raises:
        RecipeConflictError: `out` holds a dataset of another recipe.
        BuildError: `out` holds something else, or no episode falls into the train split.
        SchemaError: the parts do not hold what `order` names, or do not fit together.
        DatasetError: a part is damaged.
    """
    if not is_vacant(out):
        return _existing(out, recipe)
    table = _episode_table(recipe, parts, order, splits)
    names = (*FIELDS, *_optional(parts, optional))
    source = _Parts(parts, order, table, names, consume)
    return write_dataset(out, recipe, source, checkpoints, progress=progress)


class ShardSource(Protocol):
    """Where the rows of a new dataset come from."""

    @property
    def table(self) -> EpisodeTable: ...  # the episodes, in the order of the new dataset

    @property
    def names(self) -> Sequence[str]: ...  # of the arrays that it has

    def row_shape(self, name: str) -> tuple[int, ...]: ...  # of an array over time

    def dtype(self, name: str) -> DType: ...  # one of `Field.dtypes`

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        """Consecutive rows of an array over time, one block per episode, of any of the dtypes."""
        ...


def write_dataset(
    out: Path,
    recipe: Origin,
    source: ShardSource,
    checkpoints: Mapping[str, bytes] = MappingProxyType({}),
    *,
    progress: bool = False,
) -> Manifest:
    """Writes the finished dataset folder from any source of rows; otherwise as `assemble`."""
    if not is_vacant(out):
        return _existing(out, recipe)
    shards = {name: _planned(source, name) for name in sorted(source.names)}
    from swarmdata.store.arrays.attributes import attributes_of  # noqa: PLC0415  (numba, for writers only)

    described = attributes_of(recipe, {name: shard.shape for name, shard in shards.items()})
    with new_folder(out, last=MANIFEST) as temporary:
        create_metadata(temporary, shards, _attributes(recipe), described)
        kept = _keep(temporary, checkpoints)
        manifest = _write(temporary, recipe, source, shards, kept, progress)
        (temporary / MANIFEST).write_bytes(manifest.to_bytes())
    published = _existing(out, recipe)
    if published.digest != manifest.digest:
        raise BuildError(
            f"{out} was published by another process with digest {published.digest}, this process "
            f"made {manifest.digest} from the same recipe: generation was not deterministic"
        )
    return published


def _optional(parts: Parts, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """The optional arrays, which all parts have or none."""
    kinds = {optional_fields(folder) for folders in parts.values() for folder in folders}
    if len(kinds) != 1:
        raise SchemaError(f"the parts have different arrays: {sorted(kinds)}, expected the same")
    there = kinds.pop()
    if wanted is not None and not set(wanted) <= set(there):
        raise SchemaError(f"the parts have the arrays {there}, expected {sorted(wanted)}")
    return there if wanted is None else tuple(wanted)


def _existing(out: Path, recipe: Origin) -> Manifest:
    try:
        manifest = read_manifest(out)
    except DatasetError as error:
        raise BuildError(f"{out} exists and is not a finished dataset: {error}") from error
    check_recipe(out, manifest, MadeFrom(recipe.id, recipe.hash()))
    return manifest


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """Streams the rows of every array out of parts, episode by episode."""

    parts: Parts
    order: Order
    table: EpisodeTable
    names: tuple[str, ...]
    consume: bool

    def row_shape(self, name: str) -> tuple[int, ...]:
        return next(self.blocks(name)).shape[1:]

    def dtype(self, name: str) -> DType:
        """Parts of an older version have images as float32."""
        folders = (folder for folders in self.parts.values() for folder in folders)
        return common_dtype(name, (part_dtype(folder, name) for folder in folders))

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        streams = {
            policy: enumerate(episode_slices(paths, name, consume=self.consume))
            for policy, paths in self.parts.items()
        }
        for policy, episode in self.order:
            yield next(block for index, block in streams[policy] if index == episode)


def _planned(source: ShardSource, name: str) -> Shard:
    """The byte layout of an array: a column of the episode table, or one over time."""
    table, rows = source.table, ALL_FIELDS[name].rows
    if rows == "episodes":
        return plan_shard(ALL_FIELDS[name].dtype, table.columns("episodes/")[name].shape)
    n_rows = int(table.lengths.sum()) + (len(table) if rows == "states" else 0)
    return plan_shard(source.dtype(name), (n_rows, *source.row_shape(name)))


def _blocks(source: ShardSource, name: str, dtype: DType) -> Iterator[NDArray[Any]]:
    """The rows of an array in its dtype."""
    if ALL_FIELDS[name].rows == "episodes":
        return iter([source.table.columns("episodes/")[name]])
    return (block.astype(dtype, copy=False) for block in source.blocks(name))


def _episode_table(
    recipe: Origin, parts: Parts, order: Order, splits: Counts | None
) -> EpisodeTable:
    rows, layouts = _ordered_rows(parts, order)
    lengths = rows["length"].astype(np.int64)
    policy, policy_episode = np.array(order, dtype=np.int64).T
    if not np.array_equal(rows["policy"], policy):
        raise SchemaError("the parts hold episodes of other policies than they are listed under")
    if policy.max() >= len(recipe.policies):
        raise SchemaError(
            f"policy {policy.max()} is not among the {len(recipe.policies)} of recipe"
        )
    return EpisodeTable(
        starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        seeds=rows["seed"].astype(np.uint64),
        layouts=layouts,
        split=_splits(recipe, order, splits),
        end_reason=rows["end_reason"].copy(),
        policy=policy.astype(np.uint8),
        policy_episode=policy_episode,
        team_return=rows["team_return"].astype(np.float64),
        success=rows["end_reason"] == END_REASONS.index("success"),
        robot_collisions=rows["robot_collisions"].astype(np.int64),
        obstacle_collisions=rows["obstacle_collisions"].astype(np.int64),
    )


def _splits(recipe: Origin, order: Order, splits: Counts | None) -> Counts:
    if splits is None and recipe.split_rule is not None:
        return assign_splits(recipe, order)
    if splits is None or len(splits) != len(order) or (splits >= len(SPLITS)).any():
        raise SchemaError(
            f"splits of {recipe.id} are {splits}, expected {len(order)} codes below {len(SPLITS)}"
        )
    return splits


def _ordered_rows(parts: Parts, order: Order) -> tuple[NDArray[np.void], NDArray[np.float32]]:
    """Table rows and layouts of the ordered episodes, after checking that the order is possible."""
    if not order:
        raise SchemaError("order has no episodes, expected at least 1")
    tables = {p: np.concatenate([read_part_table(f) for f in fs]) for p, fs in parts.items()}
    layouts = {p: np.concatenate([read_part_layouts(f) for f in fs]) for p, fs in parts.items()}
    last = dict.fromkeys(parts, -1)
    for policy, episode in order:
        if policy not in tables or not last[policy] < episode < len(tables[policy]):
            raise SchemaError(
                f"order names episode {episode} of policy {policy} after episode "
                f"{last.get(policy)}, expected increasing indices below "
                f"{len(tables.get(policy, ()))} (the episodes in that policy's parts)"
            )
        last[policy] = episode
    rows = np.array([tables[p][e] for p, e in order])
    return rows, np.stack([layouts[p][e] for p, e in order])


def _keep(folder: Path, checkpoints: Mapping[str, bytes]) -> list[str]:
    """Writes networks beside the arrays; returns their paths in the folder."""
    for name, content in checkpoints.items():
        (folder / CHECKPOINTS).mkdir(exist_ok=True)
        (folder / CHECKPOINTS / name).write_bytes(content)
    return [f"{CHECKPOINTS}/{name}" for name in sorted(checkpoints)]


def _write(
    folder: Path, recipe: Origin, source: ShardSource, shards: dict[str, Shard],
    kept: Sequence[str], progress: bool,
) -> Manifest:  # fmt: skip
    """Writes all arrays and the recipe; returns the manifest, which lists `kept` files as well."""
    logical = hashlib.sha256()
    train = source.table.split == SPLITS.index("train")
    if not train.any():
        raise BuildError(
            f"{recipe.id}: none of the {len(train)} episodes is in the train split, so there are "
            "no normalization statistics. Raise n_steps in the recipe."
        )
    measured, entries = _Measured(train), {}
    hidden = None if progress else True  # None: hidden where there is no terminal
    for name, shard in tqdm(shards.items(), recipe.id, unit="array", leave=False, disable=hidden):
        blocks = measured.passed(name, _blocks(source, name, shard.dtype))
        entries[name] = write_shard(folder, name, shard, blocks, logical)
    (folder / RECIPE).write_bytes(recipe.to_json().encode())
    observation_mean, observation_std = measured.moments["observations"].result()
    (reward_mean,), (reward_std,) = measured.moments["rewards"].result()
    return Manifest(
        format_version=format_version(shards.values()),
        id=recipe.id,
        recipe_hash=recipe.hash(),
        n_episodes=len(source.table),
        n_steps=int(source.table.lengths.sum()),
        digest=logical.hexdigest(),
        arrays=entries,
        files={
            name: FileEntry(size=(folder / name).stat().st_size, sha256=file_digest(folder / name))
            for name in (*expected_files(shards), *kept)
        },
        statistics=StatisticsEntry(
            observation_mean=observation_mean,
            observation_std=observation_std,
            reward_mean=reward_mean,
            reward_std=reward_std,
        ),
        provenance=provenance(recipe.spec.world, recipe.policies),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Passes the blocks of all arrays on, sorted by name, and measures those of train episodes."""

    train: Bool  # of each episode
    alive: list[Bool] = field(default_factory=list)  # likewise; empty where agents cannot leave
    moments: Mapping[str, RunningMoments] = field(
        default_factory=lambda: {"observations": RunningMoments(), "rewards": RunningMoments()}
    )

    def passed(self, name: str, blocks: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
        moments = self.moments.get(name)
        for index, block in enumerate(blocks):
            if name == "alive":
                self.alive.append(block.copy())
            if moments is not None and self.train[index]:
                moments.add(present_rows(block, self.alive[index] if self.alive else None))
            yield block


def _attributes(recipe: Origin) -> dict[str, Any]:
    """The attributes that explain the codes to readers who have only Zarr."""
    return {
        "id": recipe.id,
        "recipe_hash": recipe.hash(),  # so that arrays and recipe are held together twice
        "splits": list(SPLITS),
        "end_reasons": list(TASK_END_REASONS if recipe.recipe else END_REASONS),
        "events": list(EVENTS),
        "policies": [policy.label for policy in recipe.policies],
        "time_arrays": list(TIME_FIELDS),
    }


def own_code(
    world: TaskSpec | None = None, policies: Sequence[PolicySource] = ()
) -> dict[str, str]:
    """SHA-256 of the code of users' tasks and policies, as `provenance` has them."""
    return {f"code of {name}": code for name, code in _own(code_of, world, policies).items()}


def _own(
    find: Callable[[str, str], str | None],
    world: TaskSpec | None,
    policies: Sequence[PolicySource],
) -> dict[str, str]:
    """What `find` tells of users' tasks and policies, by name."""
    found = {f"policy {each.name}": find("policies", each.name) for each in who_acts(policies)}
    if world is not None:
        found[f"task {world.task}"] = find("tasks", world.task)
    return {name: each for name, each in found.items() if each is not None}


def provenance(
    world: TaskSpec | None = None, policies: Sequence[PolicySource] = ()
) -> dict[str, str]:
    """Versions and platform that something is made with here; in no digest.

    The packages of users' tasks and policies are named as well; `world` is what is simulated.
    """
    own = _own(package_of, world, policies)
    packages = ["swarmdata", "numpy", "numba", "pymunk", "zarr"]
    if world is not None and world.backend == "mujoco":
        packages.append("mujoco")
    return {
        **{name: version(name) for name in packages},
        **own,
        **own_code(world, policies),
        "python": platform.python_version(),
        "platform": f"{platform.system()}-{platform.machine()}",
    }
