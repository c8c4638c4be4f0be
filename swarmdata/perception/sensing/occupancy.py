"""The `occupancy` model: a coarse grid in the body's frame, and the target in polar form.

Arithmetic as in `geometry`; flags are what is stored.
"""

import math

import numpy as np

from swarmdata.numerics.geometry import bounding_radius, nearest
from swarmdata.perception.sensing.measured_world import World
from swarmdata.perception.sensing.modifiers import echoes_of
from swarmdata.perception.sensing.sensed_scene import (
    N_POLAR,
    POLAR_FEATURES,
    Scene,
    gather,
    write_polar,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, numbered
from swarmdata.specs.sensing_models import OccupancyModel
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY, X, Y
from swarmdata.types import Bool, Double, Float

CELL_CHANNELS = ("robot", "static", "payload")
"""Of each cell; the last only in tasks with movable bodies."""


class Occupancy:
    """Which cells about a robot hold what.

    Features: `scene.POLAR`, then the flags `CHANNELS` of each cell. Cell `row * cells + column` has
    its centre at ((row - m) * size, (column - m) * size) in the body's frame, m = (cells - 1) / 2:
    rows go forward, columns to the left. `robot`: the centre is in another robot's disc, inflated
    by half a cell; `static` and `payload`: it is within half a cell of such a body, or outside the
    arena. Cells beyond the robot's sensor range are zero. The grid is drawn from where the robot
    measured itself and the bodies to be.

    Args:
        model: how many cells, and how large.
        scene: what there is to see.
    """

    def __init__(self, model: OccupancyModel, scene: Scene) -> None:
        channels = CELL_CHANNELS if len(scene.bodies) else CELL_CHANNELS[:2]
        flags = (Feature(name, "flag", "", f"1 if the cell holds: {name}") for name in channels)
        self.features = (*POLAR_FEATURES, *numbered("cell", model.cells * model.cells, flags))
        self.echoes = echoes_of(self.features)
        self._scene, self._size = scene, (model.cells, model.cell_size, scene.diagonal)

    def sense(self, world: World, robots: range, active: Bool, out: Float) -> None:
        """Writes `features` of some robots of the active copies, [E, N, F]."""
        s, w, size = self._scene, world, self._size
        observe_grids(
            w.states, w.layouts, s.radii, s.ranges, s.half, s.bodies, size,
            (robots.start, robots.stop), active, out,
        )  # fmt: skip


@kernel
def _cells_between(at: float, reach: float, cells: int, size: float) -> tuple[int, int]:
    """First and one past the last cell whose centre is within `reach` of `at` on one axis."""
    middle = (cells - 1) / 2
    first = math.ceil((at - reach) / size + middle)
    last = math.floor((at + reach) / size + middle)
    return int(min(max(first, 0), cells)), int(min(max(last + 1, 0), cells))


@kernel
def _mark_disc(
    grid: Float, x: float, y: float, r: float, span: float, cells: int, size: float, n_channels: int
) -> None:
    """Flags the cells in a disc about (x, y) in the body's frame, no farther than `span`."""
    middle = (cells - 1) / 2
    row_first, row_last = _cells_between(x, r, cells, size)
    column_first, column_last = _cells_between(y, r, cells, size)
    for row in range(row_first, row_last):
        for column in range(column_first, column_last):
            cx, cy = (row - middle) * size, (column - middle) * size
            near = (cx - x) * (cx - x) + (cy - y) * (cy - y) <= r * r
            if near and cx * cx + cy * cy <= span * span:
                grid[(row * cells + column) * n_channels] = 1.0


@kernel
def _mark_robots(
    grid: Float,
    state: Float,
    i: int,
    radii: Double,
    pose: tuple[float, float, float, float],
    span: float,
    cells: int,
    size: float,
    n_channels: int,
) -> None:
    """Flags the cells in the inflated discs of all robots but robot i."""
    px, py, ux, uy = pose
    for j in range(radii.shape[0]):
        dx, dy = float(state[N_COLUMNS * j + X]) - px, float(state[N_COLUMNS * j + Y]) - py
        x, y, r = ux * dx + uy * dy, ux * dy - uy * dx, radii[j] + size / 2
        if j != i:
            _mark_disc(grid, x, y, r, span, cells, size, n_channels)


@kernel
def _mark_row(
    grid: Float,
    obstacle: Double,
    reach: float,
    pose: tuple[float, float, float, float],
    span: float,
    cells: int,
    size: float,
    n_channels: int,
) -> None:
    """Flags the cells within half a cell of a body that `reach` about its centre encloses."""
    px, py, ux, uy = pose
    dx, dy, middle = obstacle[1] - px, obstacle[2] - py, (cells - 1) / 2
    row_first, row_last = _cells_between(ux * dx + uy * dy, reach, cells, size)
    column_first, column_last = _cells_between(ux * dy - uy * dx, reach, cells, size)
    for row in range(row_first, row_last):
        for column in range(column_first, column_last):
            cx, cy = (row - middle) * size, (column - middle) * size
            if cx * cx + cy * cy <= span * span:
                wx, wy = px + ux * cx - uy * cy, py + uy * cx + ux * cy
                if nearest(wx, wy, obstacle)[0] <= size / 2:
                    grid[(row * cells + column) * n_channels] = 1.0


@kernel
def _mark_outside(
    grid: Float,
    half: Double,
    pose: tuple[float, float, float, float],
    span: float,
    cells: int,
    size: float,
    n_channels: int,
) -> None:
    """Flags the cells outside the arena."""
    px, py, ux, uy = pose
    middle = (cells - 1) / 2
    for row in range(cells):
        for column in range(cells):
            cx, cy = (row - middle) * size, (column - middle) * size
            wx, wy = px + ux * cx - uy * cy, py + uy * cx + ux * cy
            outside = abs(wx) > half[0] or abs(wy) > half[1]
            if outside and cx * cx + cy * cy <= span * span:
                grid[(row * cells + column) * n_channels] = 1.0


@kernel
def observe_grids(
    states: Float,
    layouts: Float,
    radii: Double,
    ranges: Double,
    half: Double,
    bodies: Double,
    model: tuple[int, float, float],
    robots: tuple[int, int],
    active: Bool,
    out: Float,
) -> None:
    """Writes the `occupancy` observation of some robots in every active copy.

    Args:
        states: as measured, [E, S].
        layouts: obstacles, the same, [E, M, 8].
        radii: m, [N].
        ranges: how far each robot sees, m, [N].
        half: half width and half height of the arena, m, [2].
        bodies: movable bodies, as in `Scene`, [K, 3].
        model: cells in each direction, size of a cell (m), and the arena's diagonal (m).
        robots: first, and one past the last, of those that observe.
        active: copies to observe, [E]; rows of the others are not written.
        out: written, [E, N, F].
    """
    n_agents, n_obstacles, n_bodies = radii.shape[0], layouts.shape[1], bodies.shape[0]
    cells, size, diagonal = model
    n_channels = 3 if n_bodies > 0 else 2
    rows = np.empty((n_obstacles + n_bodies, 8))
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state = states[b]
        gather(state, layouts[b], n_agents, bodies, rows)
        for i in range(robots[0], robots[1]):
            at, span = N_COLUMNS * i, ranges[i]
            px, py = float(state[at + X]), float(state[at + Y])
            ux, uy = float(state[at + UX]), float(state[at + UY])
            pose = (px, py, ux, uy)
            write_polar(out[b, i], state, i, diagonal)
            grid = out[b, i, N_POLAR : N_POLAR + cells * cells * n_channels]
            grid[:] = 0.0
            _mark_robots(grid, state, i, radii, pose, span, cells, size, n_channels)
            for m in range(rows.shape[0]):
                reach, channel = bounding_radius(rows[m]) + size / 2, 1 if m < n_obstacles else 2
                _mark_row(grid[channel:], rows[m], reach, pose, span, cells, size, n_channels)
            _mark_outside(grid[1:], half, pose, span, cells, size, n_channels)
