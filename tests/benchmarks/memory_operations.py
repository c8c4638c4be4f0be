"""Large datasets of random numbers, and the operations whose peak memory is measured on them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.audit.checks import audit
from swarmdata.building.edit import subsample_dataset
from swarmdata.cards.sections.measured_content import measure
from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.runtime.mapped_pages import release_pages
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable, open_store
from swarmdata.store.arrays.layout import ALL_FIELDS, FIELDS, DType
from swarmdata.store.assembly import assemble, write_dataset
from swarmdata.store.damage import find_damage
from swarmdata.store.episode_order import merge_order
from swarmdata.store.parts import write_part
from swarmdata.store.split_rule import assign_splits
from swarmdata.testing.synthetic import SPEC, make_recipe
from swarmdata.types import END_REASONS, Float, Int

POOL_ROWS = 1 << 14
"""Rows of random numbers that episodes are cut from."""


class Size(NamedTuple):
    """How large a dataset is."""

    n_episodes: int
    length: int  # joint steps of each episode
    spec: TaskSpec
    row_shapes: Mapping[str, tuple[int, ...]]

    @property
    def n_steps(self) -> int:
        """Joint steps."""
        return self.n_episodes * self.length


def _shapes(n: int, n_features: int, n_states: int, n_values: int, n_obstacles: int) -> Any:
    pairs = n if n_values else 0
    return {
        "observations": (n, n_features), "states": (n_states,), "sent": (n, n_values),
        "delivered": (n, pairs), "ages": (n, pairs), "actions": (n, 2), "log_probs": (n,),
        "rewards": (n,), "terminations": (), "truncations": (), "events": (n, 4),
        "episodes/layouts": (n_obstacles, 8),
    }  # fmt: skip


FOUR_ROBOTS = TaskSpec(), _shapes(4, 53, 32, 0, 6)
"""A kilobyte a step, as in the published datasets."""

TWO_ROBOTS = SPEC, _shapes(2, 15, 16, 4, 4)
"""A quarter of a kilobyte a step."""

SIZES = {
    "1M": Size(8_000, 125, *FOUR_ROBOTS),
    "5M": Size(40_000, 125, *FOUR_ROBOTS),
    "20M": Size(160_000, 125, *FOUR_ROBOTS),
    "200k-episodes": Size(200_000, 25, *TWO_ROBOTS),
    "tiny": Size(40, 25, *TWO_ROBOTS),
}
"""Datasets by the name of their column."""


@dataclass(frozen=True, eq=False)
class Generated:
    """Implements `store.assembly.Source`: random numbers, without a copy on the disk or in memory.

    An episode is a stretch of a pool of rows, which begins at a place of its own.
    """

    size: Size

    @property
    def names(self) -> tuple[str, ...]:
        """Arrays that it has."""
        return tuple(FIELDS)

    @cached_property
    def table(self) -> EpisodeTable:
        """Episodes of one policy, all cut by the horizon."""
        n, length = self.size.n_episodes, self.size.length
        numbers = np.arange(n)
        pairs = list(zip([0] * n, range(n), strict=True))
        means = self._pool("rewards").mean(axis=1, dtype=np.float64)
        returns = np.array([means[f : f + length].sum() for f in self._firsts.tolist()])
        return EpisodeTable(
            starts=numbers * length,
            lengths=np.full(n, length),
            seeds=numbers.astype(np.uint64),
            layouts=self._pool("episodes/layouts")[numbers % POOL_ROWS],
            split=assign_splits(make_recipe(self.size.n_steps, spec=self.size.spec), pairs),
            end_reason=np.full(n, END_REASONS.index("horizon"), dtype=np.uint8),
            policy=np.zeros(n, dtype=np.uint8),
            policy_episode=numbers,
            team_return=returns,
            success=np.zeros(n, dtype=np.bool_),
            robot_collisions=np.zeros(n, dtype=np.int64),
            obstacle_collisions=np.zeros(n, dtype=np.int64),
        )

    @cached_property
    def _firsts(self) -> Int:
        """Row of the pool where each episode begins, [n]."""
        places: Int = np.arange(self.size.n_episodes) * 7919 % (POOL_ROWS - self.size.length)
        return places

    def row_shape(self, name: str) -> tuple[int, ...]:
        """Shape of a row of an array over time."""
        return self.size.row_shapes[name]

    def dtype(self, name: str) -> DType:
        """The usual one."""
        return ALL_FIELDS[name].dtype

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        """Consecutive rows of the array, an episode at a time."""
        pool, length = self._pool(name), self.size.length
        rows = length + (ALL_FIELDS[name].rows == "states")
        flags = np.arange(length) == length - 1
        for first in self._firsts.tolist():
            block = pool[first : first + rows]
            yield flags if name == "truncations" else block

    def _pool(self, name: str) -> NDArray[Any]:
        shape = (POOL_ROWS, *self.size.row_shapes[name])
        if ALL_FIELDS[name].dtype != "float32":
            return np.zeros(shape, dtype=ALL_FIELDS[name].dtype)
        rng = np.random.default_rng(sum(name.encode()))
        values: Float = rng.uniform(-1, 1, size=shape).astype(np.float32)
        return values


def make(name: str, out: Path) -> None:
    """Writes the dataset of a size."""
    size = SIZES[name]
    write_dataset(out, make_recipe(size.n_steps, spec=size.spec), Generated(size))


def load(data: Path, _: Path) -> object:
    """`load`, every chunk checked."""
    return open_store(data, "fast")


def sample(data: Path, _: Path) -> object:
    """A thousand batches of 256 transitions, after `load`."""
    sampler = Dataset.open(data).split("train").sampler(256)
    return [next(sampler).rewards.mean() for _ in range(1000)]


def transitions(data: Path, _: Path) -> object:
    """All transitions as arrays in memory."""
    return Dataset.open(data, "none").transitions()


def reobserve(data: Path, _: Path) -> object:
    """The whole dataset, seen with eight lidar rays."""
    return Dataset.open(data, "none").reobserve("lidar-8", progress=False).moments


def audited(data: Path, _: Path) -> object:
    """Every check, and 64 episodes replayed."""
    return audit(data, progress=False)


def verify(data: Path, _: Path) -> object:
    """`swarmdata verify`: the SHA-256 of every file, and the logical digest."""
    open_store(data, "full")
    return find_damage(data)


def card(data: Path, _: Path) -> object:
    """Everything that a card measures of the arrays."""
    return measure(open_store(data, "none"))


def to_hdf5(data: Path, out: Path) -> object:
    """Conversion to D4RL's HDF5."""
    return export_dataset(Dataset.open(data, "none"), out / "flat.hdf5", format="d4rl")


def from_hdf5(data: Path, out: Path) -> object:
    """Conversion of that file to a dataset."""
    return import_dataset(
        out / "flat.hdf5", out / "imported", format="d4rl", id="coop_nav-imported-v0"
    )


def to_parquet(data: Path, out: Path) -> object:
    """Conversion to Parquet."""
    return export_dataset(Dataset.open(data, "none"), out / "rows", format="parquet")


def subsample(data: Path, out: Path) -> object:
    """A tenth of the steps as a dataset of its own."""
    whole = Dataset.open(data, "none")
    n_steps = max(1, whole.n_steps // 10)
    return subsample_dataset(whole, out / "smaller", id="coop_nav-smaller-v0", n_steps=n_steps)


def assembled(data: Path, out: Path) -> object:
    """A dataset of parts of 256 episodes; writing the parts is included."""
    whole = Dataset.open(data, "none")
    parts = []
    for first in range(0, len(whole), 256):
        parts.append(out / f"part-{first:06d}")
        write_part(parts[-1], [whole[k] for k in range(first, min(first + 256, len(whole)))])
        for array in whole.stored.arrays.values():
            release_pages(array)
    order = merge_order(whole.recipe, [whole.episodes.lengths.tolist()]).order  # type: ignore[arg-type]
    return assemble(
        out / "assembled", recipe=whole.recipe, parts={0: parts}, order=order, consume=True
    )


OPERATIONS: dict[str, Callable[[Path, Path], object]] = {
    "load": load,
    "load, 1,000 batches": sample,
    "transitions()": transitions,
    "reobserve": reobserve,
    "audit": audited,
    "verify": verify,
    "card": card,
    "to HDF5": to_hdf5,
    "from HDF5": from_hdf5,
    "to Parquet": to_parquet,
    "subsample": subsample,
    "assemble": assembled,
}
"""By the first cell of their row; each takes a dataset and a folder for what it writes."""
