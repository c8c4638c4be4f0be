"""Selection, episodes of open datasets as the source of a new one, copied from map to disk."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.specs.spaces import existing_choices
from swarmdata.store.arrays.layout import ALL_FIELDS, LEAVING_ARRAYS, DType, common_dtype
from swarmdata.store.stored_dataset import StoredDataset
from swarmdata.store.table import EpisodeTable
from swarmdata.types import Bool, Counts, Int, Seeds

IMPLIED_ARRAYS = (*LEAVING_ARRAYS, "action_masks")
"""Arrays that a dataset without them implies: all agents act, and may do everything."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Episodes of one open dataset."""

    stored: StoredDataset  # the open files
    episodes: Int  # their stored numbers, increasing, [n]
    policies: Mapping[int, int]  # new policy index of each old one
    seeds: Seeds | None = None  # their new seeds, [n]; None: as they are

    @property
    def table(self) -> EpisodeTable:
        """Its episodes with new policies and seeds; starts and stream numbers are the old ones."""
        rows = self.stored.table.take(self.episodes)
        policy: Counts = np.array([self.policies[p] for p in rows.policy.tolist()], dtype=np.uint8)
        return replace(rows, policy=policy, seeds=rows.seeds if self.seeds is None else self.seeds)

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        """Rows of an array over time, one block per episode."""
        if name in IMPLIED_ARRAYS and name not in self.stored.arrays:
            yield from self._implied(name)
            return
        reads = MappedReads([self.stored.arrays[name]])
        for number in self.episodes.tolist():
            rows = self.stored.rows(number, name)
            yield rows
            reads.add(rows)
        reads.release()

    def _implied(self, name: str) -> Iterator[Bool]:
        """Rows of one of `IMPLIED_ARRAYS`, where all agents act until their team ends."""
        if name == "action_masks":
            exist = existing_choices(self.stored.recipe.spec.action_spaces)
            return (alive[:, :, None] & exist for alive in self.blocks("alive"))
        n_agents = self.stored.arrays["rewards"].shape[1]
        of_team: Iterable[Bool] = (np.arange(n + 1) < n for n in self.table.lengths.tolist())
        if name != "alive":
            of_team = self.blocks(name.removeprefix("agent_"))
        return (np.repeat(rows[:, None], n_agents, axis=1) for rows in of_team)


@dataclass(frozen=True, eq=False)
class Selection:
    """Implements `assembly.ShardSource`: the episodes of all pieces, piece after piece.

    Each policy's episodes are counted anew, from 0, in this order.

    Raises:
        SchemaError: the pieces have different arrays, or arrays of different rows.
    """

    pieces: Sequence[Piece]

    def __post_init__(self) -> None:
        first = self.pieces[0].stored
        for piece in self.pieces[1:]:
            other = piece.stored
            one, two = set(first.arrays), set(other.arrays)
            differing = sorted((one ^ two) - set(IMPLIED_ARRAYS)) or [
                name
                for name in set(self.names) & one & two
                if first.arrays[name].shape[1:] != other.arrays[name].shape[1:]
            ]
            if differing:
                raise SchemaError(
                    f"{first.manifest.id} and {other.manifest.id} do not fit together: one has "
                    f"other rows of {', '.join(differing)}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Of those that say who acts and who may do what, all where a piece has them."""
        there = {name for piece in self.pieces for name in piece.stored.arrays}
        return tuple(name for name in ALL_FIELDS if name in there)

    @cached_property
    def table(self) -> EpisodeTable:
        tables = [piece.table.columns() for piece in self.pieces]
        joined = {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}
        lengths, policy = joined["lengths"], joined["policy"]
        stream = np.empty(len(policy), dtype=np.int64)
        for index in np.unique(policy):
            stream[policy == index] = np.arange(int((policy == index).sum()))
        renewed = {"starts": np.cumsum(lengths) - lengths, "policy_episode": stream}
        return EpisodeTable(**{**joined, **renewed})

    def row_shape(self, name: str) -> tuple[int, ...]:
        return self._of(name)[0].shape[1:]

    def dtype(self, name: str) -> DType:
        """Images that another version recorded are float32."""
        return common_dtype(name, (str(array.dtype) for array in self._of(name)))

    def _of(self, name: str) -> list[NDArray[Any]]:
        """An array of all pieces that have it."""
        found = (piece.stored.arrays.get(name) for piece in self.pieces)
        return [array for array in found if array is not None]

    def blocks(self, name: str) -> Iterator[NDArray[Any]]:
        return chain.from_iterable(piece.blocks(name) for piece in self.pieces)
