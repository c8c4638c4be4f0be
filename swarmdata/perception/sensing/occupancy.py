"""The `occupancy` model: a coarse grid in the body's frame, and the target in polar form."""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.numerics.geometry import nearest
from swarmdata.perception.sensing.measured_world import Sense, World
from swarmdata.perception.sensing.modifiers import echoes_of
from swarmdata.perception.sensing.sensed_scene import (
    N_POLAR,
    POLAR_FEATURES,
    SCENE,
    Scene,
    gather,
    write_polar,
)
from swarmdata.runtime.argument_blocks import ArgumentBlock, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, numbered
from swarmdata.specs.sensing_models import OccupancyModel
from swarmdata.specs.state_layout import N_COLUMNS, UX, UY, X, Y
from swarmdata.types import Bool, Double, Float, Int

CELL_CHANNELS = ("robot", "static", "payload")
"""Flags of each cell; the last only in tasks with movable bodies."""

Pose = tuple[float, float, float, float]  # position, m, and heading, a unit vector


class Grid(NamedTuple):
    """The grid of a robot."""

    cells: int  # in each direction
    size: float  # m, of a cell
    n_channels: int


def occupancy_sense(model: OccupancyModel, scene: Scene) -> Sense:
    """The contents of the cells around a robot, as measured.

    Features: `POLAR_FEATURES`, then the flags `CELL_CHANNELS` of each cell. Cell `row * cells +
    column` has its centre at ((row - m) * size, (column - m) * size) in the body's frame, m =
    (cells - 1) / 2: rows go forward, columns to the left. `robot`: the centre is in another robot's
    disc, inflated by half a cell; `static`: it is within half a cell of an obstacle, or outside the
    arena; `payload`: it is within half a cell of a movable body. Cells beyond the robot's sensor
    range are zero.
    """
    channels = CELL_CHANNELS if len(scene.bodies) else CELL_CHANNELS[:2]
    flags = (Feature(name, "flag", "", f"1 if the cell holds: {name}") for name in channels)
    features = (*POLAR_FEATURES, *numbered("cell", model.cells * model.cells, flags))
    block = ArgumentBlock(scene._replace(n_parts=model.cells, span=model.cell_size), SCENE)

    def sense(world: World, robots: range, active: Bool, out: Float) -> None:
        observe_grids(
            block.packed, world.states, world.layouts, world.poses, robots.start, robots.stop,
            active, out,
        )  # fmt: skip

    return Sense(features, echoes_of(features), sense)


@kernel
def _near_cells(x: float, y: float, reach: float, grid: Grid) -> tuple[int, int, int, int]:
    """First, and one past the last, row and column of centres within `reach` on each axis."""
    row_first, row_end = _cells_between(x, reach, grid)
    column_first, column_end = _cells_between(y, reach, grid)
    return row_first, row_end, column_first, column_end


@kernel
def _cells_between(at: float, reach: float, grid: Grid) -> tuple[int, int]:
    """First, and one past the last, cell whose centre is within `reach` of `at` on one axis."""
    cells, size, middle = grid.cells, grid.size, (grid.cells - 1) / 2
    first = math.ceil((at - reach) / size + middle)
    last = math.floor((at + reach) / size + middle)
    return int(min(max(first, 0), cells)), int(min(max(last + 1, 0), cells))


@kernel
def _mark_disc(flags: Float, x: float, y: float, r: float, span: float, grid: Grid) -> None:
    """Flags the cells in a disc about (x, y) in the body's frame, no farther than `span`."""
    size, middle = grid.size, (grid.cells - 1) / 2
    row_first, row_end, column_first, column_end = _near_cells(x, y, r, grid)
    for row in range(row_first, row_end):
        for column in range(column_first, column_end):
            cx, cy = (row - middle) * size, (column - middle) * size
            is_inside = (cx - x) * (cx - x) + (cy - y) * (cy - y) <= r * r
            if is_inside and cx * cx + cy * cy <= span * span:
                flags[(row * grid.cells + column) * grid.n_channels] = 1.0


@kernel
def _mark_row(
    flags: Float, obstacle: Double, reach: float, pose: Pose, span: float, grid: Grid
) -> None:
    """Flags the cells within half a cell of a body that `reach` about its centre encloses."""
    px, py, ux, uy = pose
    size, middle = grid.size, (grid.cells - 1) / 2
    dx, dy = obstacle[1] - px, obstacle[2] - py
    x, y = ux * dx + uy * dy, ux * dy - uy * dx
    row_first, row_end, column_first, column_end = _near_cells(x, y, reach, grid)
    for row in range(row_first, row_end):
        for column in range(column_first, column_end):
            cx, cy = (row - middle) * size, (column - middle) * size
            if cx * cx + cy * cy <= span * span:
                wx, wy = px + ux * cx - uy * cy, py + uy * cx + ux * cy
                if nearest(wx, wy, obstacle)[0] <= size / 2:
                    flags[(row * grid.cells + column) * grid.n_channels] = 1.0


@kernel
def _mark_outside(flags: Float, half: Double, pose: Pose, span: float, grid: Grid) -> None:
    px, py, ux, uy = pose
    size, middle = grid.size, (grid.cells - 1) / 2
    for row in range(grid.cells):
        for column in range(grid.cells):
            cx, cy = (row - middle) * size, (column - middle) * size
            wx, wy = px + ux * cx - uy * cy, py + uy * cx + ux * cy
            is_outside = abs(wx) > half[0] or abs(wy) > half[1]
            if is_outside and cx * cx + cy * cy <= span * span:
                flags[(row * grid.cells + column) * grid.n_channels] = 1.0


@kernel
def observe_grids(
    packed: Int,  # `Scene`, of an `ArgumentBlock`
    states: Float,  # [E, S] as measured
    layouts: Float,  # [E, M, 8] obstacles as measured
    poses: Float,  # [E, >= 8 N] robots as measured, from which the arena's walls are seen
    first_robot: int,  # that observes
    end_robot: int,  # one past the last
    active: Bool,  # copies to observe, [E]; rows of the others are not written
    out: Float,  # [E, N, F] written
) -> None:
    """Writes the `occupancy` observation of some robots in every active copy."""
    n_agents, radii, ranges, half, diagonal, bodies, _, n_cells, cell_size, _rays = unpack(
        packed, SCENE
    )
    n_obstacles, n_bodies = layouts.shape[1], bodies.shape[0]
    n_rows = n_obstacles + n_bodies
    grid = Grid(n_cells, cell_size, 3 if n_bodies > 0 else 2)
    n_flags, half_cell = grid.cells * grid.cells * grid.n_channels, grid.size / 2
    rows, sizes = np.empty((n_rows, 8)), np.empty(n_rows)
    for b in range(active.shape[0]):
        if not active[b]:
            continue
        state = states[b]
        gather(state, layouts[b], n_agents, bodies, rows, sizes)
        for i in range(first_robot, end_robot):
            at, span = N_COLUMNS * i, ranges[i]
            px, py = float(state[at + X]), float(state[at + Y])
            ux, uy = float(state[at + UX]), float(state[at + UY])
            pose = (px, py, ux, uy)
            write_polar(out[b, i], state, i, diagonal)
            flags = out[b, i, N_POLAR : N_POLAR + n_flags]
            flags[:] = 0.0
            for j in range(n_agents):
                dx, dy = float(state[N_COLUMNS * j + X]) - px, float(state[N_COLUMNS * j + Y]) - py
                x, y = ux * dx + uy * dy, ux * dy - uy * dx
                if j != i:
                    _mark_disc(flags, x, y, radii[j] + half_cell, span, grid)
            for m in range(n_rows):
                channel = 1 if m < n_obstacles else 2
                _mark_row(flags[channel:], rows[m], sizes[m] + half_cell, pose, span, grid)
            own = poses[b, at : at + N_COLUMNS]
            pose = (float(own[X]), float(own[Y]), float(own[UX]), float(own[UY]))
            _mark_outside(flags[1:], half, pose, span, grid)
