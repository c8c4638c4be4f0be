"""Counts robots' visits to the cells of a grid over the arena, and finds the free cells."""

import math
from dataclasses import dataclass

import numpy as np

from swarmdata.numerics.geometry import clearance
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int

CELL_SIZE = 0.1  # side of a cell, m

MAX_LAYOUTS = 32
"""Most layouts in which free cells are searched. If obstacles are drawn anew in every episode,
nearly every cell is free in one of so many layouts; if they are fixed, all layouts are equal."""

_PROBES_PER_SIDE = 4  # points along each side of a cell that are tested as a robot's centre


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Visits of robots' centres to the cells of the arena; the first row is at the bottom wall.

    Visits to cells that count as not free (by a robot pressed into a wall) are in `visits`, but not
    in `visited` and `entropy`.
    """

    visits: Int  # [rows, columns] robot-steps
    free: Bool  # [rows, columns] a robot's centre can be there in some episode
    cell: float  # m

    @property
    def n_free(self) -> int:
        """Number of free cells."""
        return int(self.free.sum())

    @property
    def visited(self) -> float:
        """Share of the free cells that a robot visited at least once."""
        return float((self.visits[self.free] > 0).mean())

    @property
    def entropy(self) -> float:
        """Shannon entropy of visits to free cells over that of equal ones; 1 of a single cell."""
        counts = self.visits[self.free & (self.visits > 0)]
        if self.n_free == 1 or len(counts) == 0:
            return float(self.n_free == 1)
        shares = counts / counts.sum()
        return float(-(shares * np.log(shares)).sum() / math.log(self.n_free))


def occupancy(states: Float, layouts: Float, spec: TaskSpec, cell: float = CELL_SIZE) -> Occupancy:
    """Counts the visits of all robots.

    A cell is free if, in one of at most `MAX_LAYOUTS` layouts spread evenly over those given, one
    of 4 x 4 points in it is at least the smallest robot's radius away from walls and obstacles.

    Args:
        states: at least one state of the task, [n, S].
        layouts: obstacles of the episodes, [E, M, 8]; M may be 0, E may not.
        spec: the task.
        cell: side of a cell, m; if the arena is no multiple of it, the last row and column are cut.
    """
    half = np.array(spec.half_size)
    shape = tuple(max(1, math.ceil(round(2 * side / cell, 9))) for side in half[::-1])
    places = robots_of(states, spec.n_agents)[..., [X, Y]].reshape(-1, 2)
    columns, rows = (
        np.clip(((places[:, axis] + half[axis]) / cell).astype(np.int64), 0, shape[1 - axis] - 1)
        for axis in (0, 1)
    )
    visits = np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1]).reshape(shape)
    chosen = np.unique(np.linspace(0, len(layouts) - 1, MAX_LAYOUTS).astype(np.int64))
    radius = min(robot.radius for robot in spec.robots)
    free = np.zeros(shape, np.bool_)
    _find_free(np.ascontiguousarray(layouts[chosen]), half, radius, cell, free)
    return Occupancy(visits, free, cell)


@kernel
def _is_free(
    row: int, column: int, layout: Float, half: Double, radius: float, cell: float
) -> bool:
    """Whether some point of a cell is far enough from walls and obstacles in one layout."""
    for k in range(_PROBES_PER_SIDE * _PROBES_PER_SIDE):
        x = (column + (k % _PROBES_PER_SIDE + 0.5) / _PROBES_PER_SIDE) * cell - half[0]
        y = (row + (k // _PROBES_PER_SIDE + 0.5) / _PROBES_PER_SIDE) * cell - half[1]
        if clearance(x, y, layout, half) >= radius:
            return True
    return False


@kernel
def _find_free(layouts: Float, half: Double, radius: float, cell: float, free: Bool) -> None:
    for row in range(free.shape[0]):
        for column in range(free.shape[1]):
            for layout in layouts:
                if _is_free(row, column, layout, half, radius, cell):
                    free[row, column] = True
                    break
