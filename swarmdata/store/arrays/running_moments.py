"""Mean and standard deviation of streamed rows, independent of chunking and of threads."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from swarmdata.runtime.mapped_pages import MappedReads
from swarmdata.types import Bool, Counts, Double, Float

if TYPE_CHECKING:
    from swarmdata.store.stored_dataset import StoredDataset

BLOCK_NUMBERS = 1 << 20  # most numbers of images that are unpacked to float64 at a time


@dataclass(slots=True)
class RunningMoments:
    """Running float64 sums over blocks of rows, in the order of the calls.

    They are taken around the first row (Chan, Golub and LeVeque, "Algorithms for computing the
    sample variance", The American Statistician 37(3), 1983, section 3), so that a constant column
    has a deviation of exactly 0.
    """

    shift: Double | None = None  # [F]
    count: int = 0
    total: Double = field(default_factory=lambda: np.zeros(1))  # [F]
    squares: Double = field(default_factory=lambda: np.zeros(1))  # [F]

    def add(self, rows: Float | Counts) -> None:
        """Takes more rows, [n, F], those of images in blocks, whose sums are exact in any order."""
        n_rows = max(1, len(rows))
        if rows.dtype == np.uint8:
            n_rows = max(1, BLOCK_NUMBERS // max(1, rows.shape[1]))
        for first in range(0, len(rows), n_rows):
            self._add(rows[first : first + n_rows])

    def _add(self, rows: Float | Counts) -> None:
        values = rows.astype(np.float64)
        if self.shift is None:
            self.shift = values[0].copy()
        values -= self.shift
        self.count += len(values)
        self.total = self.total + np.add.reduce(values, axis=0)
        self.squares = self.squares + np.add.reduce(values * values, axis=0)

    def result(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Returns the mean and the population standard deviation of each column, F long."""
        if self.shift is None:
            raise ValueError("moments of no rows")
        offset = self.total / self.count
        variance = np.maximum(self.squares / self.count - offset * offset, 0.0)
        mean, std = self.shift + offset, np.sqrt(variance)
        return tuple(map(float, mean)), tuple(map(float, std))


def present_rows(rows: Float | Counts, alive: Bool | None) -> Float | Counts:
    """Returns the rows of an episode that agents observed, or were rewarded in, [n, F].

    Rows are [T+1, N, F] or [T, N]. `alive`, [T+1, N], leaves out those of absent agents, which are
    zeros that nobody measured; agents also observe the state in which they leave. None: all count.
    """
    width = rows.shape[2] if rows.ndim == 3 else 1
    if alive is not None:
        acting, seen = alive[:-1], alive.copy()
        seen[1:] |= acting
        rows = rows[seen if len(rows) == len(alive) else acting]
    return rows.reshape(-1, width)


def train_moments(stored: "StoredDataset", name: str) -> tuple[Double, Double]:
    """Mean and deviation of an array over the train split, present agents and time, [F] each.

    F is the size of the last axis of observations, and 1 of rewards.
    """
    moments, reads = RunningMoments(), MappedReads((stored.arrays[name],))
    for number in np.flatnonzero(stored.table.split == 0).tolist():
        rows = stored.rows(number, name)
        alive = stored.rows(number, "alive") if "alive" in stored.arrays else None
        moments.add(present_rows(rows, alive))
        reads.add(rows)
    reads.release()
    mean, std = moments.result()
    return np.array(mean), np.array(std)
