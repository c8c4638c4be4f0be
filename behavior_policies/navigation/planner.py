"""Waypoints: the farthest point of a robot's way to its goal that it reaches in a straight line."""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.distance_field import (
    MARGIN,
    SPACING,
    Int32,
    fill_ways,
    nearest_node,
    weights_of,
)
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float, Int

LOOKAHEAD = 40
"""Nodes of the way that are searched for a visible one: 2 to 2.8 m."""

UNPLANNED = -2
"""Cost of node 0 until the ways are computed, which is when the goal is out of sight for the first
time: a robot that always sees its goal needs none. Node 0 lies in a wall."""

N_PRIMITIVES = {CIRCLE: 1, BOX: 1, CORNER: 2, POCKET: 3}


@kernel
def free_distance(x: float, y: float, grid: Float, half: Double) -> float:
    """Returns the clearance at a point, interpolated bilinearly; points outside are moved in.

    Args:
        x: point, m.
        y: point, m.
        grid: clearances of the nodes, m, [rows, columns].
        half: half width and half height of the arena, m, [2].
    """
    u = min(max((x + half[0]) / SPACING, 0.0), grid.shape[1] - 1.001)
    v = min(max((y + half[1]) / SPACING, 0.0), grid.shape[0] - 1.001)
    column, row = int(u), int(v)
    u, v = u - column, v - row
    below = (1.0 - u) * grid[row, column] + u * grid[row, column + 1]
    above = (1.0 - u) * grid[row + 1, column] + u * grid[row + 1, column + 1]
    return float((1.0 - v) * below + v * above)


@kernel
def is_visible(
    x: float, y: float, to_x: float, to_y: float, need: float, grid: Float, half: Double
) -> bool:
    """Returns whether the straight line between two points keeps `need` metres of clearance.

    Where the start or the end has less, the line may have as little. The line is walked in steps as
    long as what is free beyond the need, at least half a spacing ("Sphere tracing", The Visual
    Computer 12, 1996, section 2).
    """
    dx, dy = to_x - x, to_y - y
    length = math.sqrt(dx * dx + dy * dy)
    need = min(need, free_distance(x, y, grid, half) - 1e-3)
    need = min(need, free_distance(to_x, to_y, grid, half) - 1e-3)
    walked = 0.0
    while walked < length:
        share = walked / length
        free = free_distance(x + share * dx, y + share * dy, grid, half) - need
        if free < 0.0:
            return False
        walked += max(free, 0.5 * SPACING)
    return True


@kernel
def waypoint(
    position: tuple[float, float],
    goal: Double,
    radius: float,
    grid: Float,
    ways: tuple[Int32, Int32],
    half: Double,
) -> tuple[float, float]:
    """Returns the point to aim at: the goal if visible, else the farthest visible node of the way.

    Args:
        position: m.
        goal: m, [2].
        radius: of the robot, m.
        grid: clearances, m, [rows, columns].
        ways: costs and next nodes, each [n]; written when they are `UNPLANNED`.
        half: half width and half height of the arena, m, [2].

    Returns:
        The point, m. Where the map has no way at all, it is the goal.
    """
    x, y = position
    need = radius + MARGIN
    if is_visible(x, y, goal[0], goal[1], need, grid, half):
        return goal[0], goal[1]
    costs, following = ways
    columns = grid.shape[1]
    if costs[0] == UNPLANNED:
        weights = weights_of(grid, radius)
        end = nearest_node(goal[0], goal[1], weights - 1, columns, half)
        if end < 0:
            costs[:] = -1
        else:
            fill_ways(end, columns, weights, costs, following)
    node = nearest_node(x, y, costs, columns, half)
    if node < 0:
        return goal[0], goal[1]
    best = following[node]
    for hop in range(LOOKAHEAD):
        node = following[node]
        if hop % 2 == 1:
            to_x = (node % columns) * SPACING - half[0]
            to_y = (node // columns) * SPACING - half[1]
            if not is_visible(x, y, to_x, to_y, need, grid, half):
                break
            best = node
    return (best % columns) * SPACING - half[0], (best // columns) * SPACING - half[1]


def primitives_of(layout: Float) -> Float:
    """Returns the same obstacles as convex shapes: a corner is 2 boxes, a pocket 3.

    Args:
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].

    Returns:
        Circles and boxes, the same columns, [P, 8].
    """
    shapes = [_bar(row, k) for row in layout for k in range(N_PRIMITIVES[float(row[0])])]
    return np.array(shapes, dtype=np.float32).reshape(-1, 8)


def _bar(row: Float, k: int) -> Float:
    """Convex part k of an obstacle: the bar along -y, then along -x, then along +x."""
    kind, x, y, ux, uy, a, b, t = (float(value) for value in row)
    if kind in (CIRCLE, BOX):
        return row
    cx, cy, hx, hy = ((0.0, t - b, a, t), (t - a, 0.0, t, b), (a - t, 0.0, t, b))[k]
    centre = (x + cx * ux - cy * uy, y + cx * uy + cy * ux)
    return np.array([BOX, *centre, ux, uy, hx, hy, 0.0], dtype=np.float32)


def n_primitives(kinds: Int) -> int:
    """Number of convex shapes in a layout of obstacles of these shape codes, [M], P."""
    return sum(N_PRIMITIVES[float(kind)] for kind in kinds)
