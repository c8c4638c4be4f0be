"""Subject, the dataset under audit, and how its rows are read and named."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarmdata.runtime.mapped_pages import release_pages
from swarmdata.specs.origins import Origin, Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable, Manifest, StoredDataset
from swarmdata.store.arrays.layout import ALL_FIELDS
from swarmdata.types import Int

BLOCK_ROWS = 10_000  # rows that are checked together: memory stays bounded, and one call does much


@dataclass(frozen=True, eq=False)
class Subject:
    """A dataset under audit."""

    stored: StoredDataset  # the open files
    path: Path
    manifest: Manifest
    origin: Origin
    table: EpisodeTable
    arrays: dict[str, NDArray[Any]]
    sample: int  # episodes to replay
    progress: bool  # whether to show bars

    @classmethod
    def of(cls, stored: StoredDataset, sample: int, progress: bool) -> Self:
        parts = stored.path, stored.manifest, stored.recipe, stored.table, stored.arrays
        return cls(stored, *parts, sample, progress)

    @property
    def spec(self) -> Spec:
        return self.origin.spec

    @property
    def task(self) -> TaskSpec | None:
        """The task of this library that was recorded, if it is one."""
        return self.spec.world

    @cached_property
    def state_starts(self) -> Int:
        """First row of each episode in the arrays with T + 1 rows, [n]."""
        starts: Int = self.table.starts + np.arange(len(self.table))
        return starts

    @property
    def final_states(self) -> Int:
        """Last row of each episode in the arrays with T + 1 rows, [n]."""
        final: Int = self.state_starts + self.table.lengths
        return final

    @property
    def last_steps(self) -> Int:
        """Last row of each episode in the arrays with T rows, [n]."""
        last: Int = self.table.starts + self.table.lengths - 1
        return last

    def starts_of(self, name: str) -> Int:
        """First row of each episode in the array `name`, [n]."""
        if ALL_FIELDS[name].rows == "steps":
            return self.table.starts
        return (
            self.state_starts if ALL_FIELDS[name].rows == "states" else np.arange(len(self.table))
        )

    def place(self, name: str, row: int) -> str:
        """Describes a row of the array `name`, such as "episode 3, step 17"."""
        episode = int(np.searchsorted(self.starts_of(name), row, side="right")) - 1
        if ALL_FIELDS[name].rows == "episodes":
            return f"episode {row}"
        return f"episode {episode}, step {row - int(self.starts_of(name)[episode])}"

    def rows_of(self, name: str, episodes: slice) -> NDArray[Any]:
        starts, extra = self.starts_of(name)[episodes], int(ALL_FIELDS[name].rows == "states")
        last = int(starts[-1] + self.table.lengths[episodes][-1]) + extra
        rows: NDArray[Any] = self.arrays[name][int(starts[0]) : last]
        return rows

    def episode_groups(self) -> Iterator[slice]:
        """Yields consecutive episodes with about `BLOCK_ROWS` steps together, at least one.

        Pages of all arrays are given back after each.
        """
        ends, first = self.table.starts + self.table.lengths, 0
        while first < len(ends):
            limit = int(self.table.starts[first]) + BLOCK_ROWS
            last = max(first + 1, int(np.searchsorted(ends, limit, side="right")))
            yield slice(first, last)
            self.release()
            first = last

    def release(self) -> None:
        """Gives back the pages of all arrays."""
        for array in self.arrays.values():
            release_pages(array)


def blocks(array: NDArray[Any]) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yields consecutive blocks of rows, each with the index of its first row.

    Pages of a block are given back after it.
    """
    for first in range(0, len(array), BLOCK_ROWS):
        block = array[first : first + BLOCK_ROWS]
        yield first, block
        release_pages(block)


def some(indices: Int) -> str:
    """The first of many indices in words, such as "3, 5, 9 and 12 more"."""
    shown = ", ".join(map(str, indices[:3].tolist()))
    return shown if len(indices) <= 3 else f"{shown} and {len(indices) - 3} more"
