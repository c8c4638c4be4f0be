"""Replay of K seeds in lockstep, in a ring file that a resumed run finds as it left it.

A row holds one step of all copies: [K, E, record], a record being a joint transition. The newest
`capacity` rows are drawn from; `margin` more rows lie in the ring, so that a run may write that
many after a checkpoint and be killed. A checkpoint keeps the position and a CRC-32 of each row,
with which `load_state_dict` makes sure that it found the same rows.
"""

import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import CheckpointError, SchemaError
from swarmdata.learn.networks.setup import Sizes
from swarmdata.runtime.atomic import staged
from swarmdata.types import Batch

REPLAY_FILE = "replay.f32"


@dataclass(frozen=True, slots=True)
class Shape:
    """Sizes of a replay; SchemaError if a number is too small."""

    sizes: Sizes
    n_seeds: int  # K
    n_copies: int  # E
    capacity: int  # rows that are drawn from
    margin: int  # rows that may follow a checkpoint

    def __post_init__(self) -> None:
        if min(self.n_seeds, self.n_copies, self.capacity) < 1 or self.margin < 0:
            raise SchemaError(
                f"{self}: expected at least one seed, copy and row, and no negative margin"
            )

    @property
    def columns(self) -> tuple[int, ...]:
        """Numbers in a record: observations, states, both of the next step, actions, rewards, end.

        The next step is the one reached, before any reset.
        """
        s = self.sizes
        n_observed, n = s.n_agents * s.observation, s.n_agents
        return (n_observed, s.state, n_observed, s.state, n * s.action, n, 2)

    @property
    def n_rows(self) -> int:
        return self.capacity + self.margin

    @property
    def array(self) -> tuple[int, int, int, int]:
        """Shape of the ring, float32."""
        return (self.n_rows, self.n_seeds, self.n_copies, sum(self.columns))


class Replay:
    """The transitions that K seeds met, the newest `capacity` rows of them.

    A ring that is in the folder already is kept until it is written to, for `load_state_dict`.
    """

    def __init__(self, shape: Shape, folder: Path | str) -> None:
        self.shape, self.path = shape, Path(folder) / REPLAY_FILE
        self.n_written = 0  # rows, ever
        self._checksums = np.zeros(shape.n_rows, np.int64)
        self._ring = open_map(self.path, shape.array)

    def __len__(self) -> int:
        return min(self.n_written, self.shape.capacity)

    def append(self, batch: Batch) -> None:
        """Writes one step of all copies, arrays [K, E, ...], over the oldest row."""
        slot = self.n_written % self.shape.n_rows
        row = self._ring[slot]
        flags = np.stack([batch.terminations, batch.truncations], axis=-1)
        fields = (
            batch.observations, batch.states, batch.next_observations, batch.next_states,
            batch.actions, batch.rewards, flags,
        )  # fmt: skip
        start = 0
        for values, width in zip(fields, self.shape.columns, strict=True):
            flat = np.asarray(values).reshape(*row.shape[:2], -1)
            if flat.shape[-1] != width:
                raise SchemaError(
                    f"got a field of {flat.shape[-1]} numbers per copy, expected {width}: the "
                    f"replay was made for {self.shape.sizes}"
                )
            row[..., start : start + width] = flat
            start += width
        self._checksums[slot] = zlib.crc32(row)
        self.n_written += 1

    def sample(self, generators: Sequence[torch.Generator], batch_size: int) -> Batch:
        """Draws transitions uniformly, with replacement; tensors [K, B, ...], B = `batch_size`.

        There is one generator for each seed, on the CPU.
        """
        if not len(self):
            raise SchemaError("the replay is empty; append at least one row before drawing")
        n_copies = self.shape.n_copies
        drawn = torch.stack([
            torch.randint(len(self) * n_copies, (batch_size,), generator=g) for g in generators
        ]).numpy()  # fmt: skip
        first = self.n_written - len(self)
        slots, copies = (first + drawn // n_copies) % self.shape.n_rows, drawn % n_copies
        seeds = np.arange(self.shape.n_seeds)[:, None]
        return self._batch(torch.from_numpy(np.asarray(self._ring[slots, seeds, copies])))

    def _batch(self, records: Tensor) -> Batch:
        """Names the columns of records [K, B, record]."""
        n_agents = self.shape.sizes.n_agents
        parts = torch.split(records, list(self.shape.columns), -1)
        observations, states, next_observations, next_states, actions, rewards, flags = parts
        by_robot = (*records.shape[:2], n_agents, -1)
        return Batch(
            observations=observations.view(by_robot),
            actions=actions.view(by_robot),
            rewards=rewards,
            next_observations=next_observations.view(by_robot),
            states=states,
            next_states=next_states,
            terminations=flags[..., 0] > 0,
            truncations=flags[..., 1] > 0,
            mask=torch.ones(records.shape[:2], dtype=torch.bool),
        )

    def state_dict(self) -> dict[str, Tensor]:
        """Position and checksums; the rows are on disk when this returns."""
        self._ring.flush()
        return {
            "n_written": torch.tensor(self.n_written),
            "checksums": torch.from_numpy(self._checksums.copy()),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        checksums = np.asarray(state["checksums"])
        if checksums.shape != self._checksums.shape:
            raise CheckpointError(
                f"the checkpoint's replay has {len(checksums)} rows, expected {self.shape.n_rows}: "
                "it was written with another capacity or margin"
            )
        n_written = int(state["n_written"])
        for number in range(max(0, n_written - self.shape.capacity), n_written):
            slot = number % self.shape.n_rows
            if zlib.crc32(self._ring[slot]) != checksums[slot]:
                raise CheckpointError(
                    f"{self.path} does not hold row {number} as the checkpoint knows it: the run "
                    f"went on for more than {self.shape.margin} rows after it, or the file is "
                    "damaged or another run's. Train again in another folder."
                )
        self.n_written, self._checksums = n_written, checksums.copy()


def open_map(path: Path, shape: tuple[int, ...]) -> "np.memmap[Any, np.dtype[np.float32]]":
    """Maps a file of float32, made if there is none.

    All of it is reserved at once: a full disk ends a process that writes to a map, without a word.
    """
    size = 4 * int(np.prod(shape))
    if not path.exists():
        with staged(path) as target, target.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    found = path.stat().st_size
    if found != size:
        raise CheckpointError(
            f"{path} has {found} bytes, expected {size}: it belongs to another run. Choose "
            "another folder, or move that one away."
        )
    return np.memmap(path, np.float32, "r+", shape=shape)
