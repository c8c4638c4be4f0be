"""Waypoints: the farthest point of a robot's path that it can reach in a straight line."""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.numerics.distance_field import (
    PATH_GAP,
    Ground,
    Int8,
    Int32,
    fill_paths,
    nearest_node,
    next_of,
    weights_of,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

LOOKAHEAD_NODES = 40
"""Nodes of the path that are searched for a visible one: 2 to 2.8 m with a spacing of 0.05 m."""

_ROUNDING = 1e-7
"""More (m) than rounding errors of clearances."""

UNPLANNED_COST = -2
"""Cost of node 0 until the paths are planned, which is when the goal is out of sight for the first
time: a robot that always sees its goal needs none. Node 0 lies in a wall."""


class Paths(NamedTuple):
    """The cheapest paths from all nodes to one goal."""

    costs: Int32  # [n] -1 where there is no path; costs[0] is `UNPLANNED_COST` before planning
    moves: Int8  # [n] to the next node on the path, for `next_of`


@kernel(error_model="numpy")
def free_distance(x: float, y: float, ground: Ground) -> float:
    """Returns the clearance at a point, m, interpolated bilinearly; outside points are moved in."""
    grid, half, spacing = ground
    u = min(max((x + half[0]) / spacing, 0.0), grid.shape[1] - 1.001)
    v = min(max((y + half[1]) / spacing, 0.0), grid.shape[0] - 1.001)
    column, row = int(u), int(v)
    u, v = u - column, v - row
    below = (1.0 - u) * grid[row, column] + u * grid[row, column + 1]
    above = (1.0 - u) * grid[row + 1, column] + u * grid[row + 1, column + 1]
    return float((1.0 - v) * below + v * above)


@kernel(error_model="numpy")
def is_clear(x: float, y: float, dx: float, dy: float, need: float, ground: Ground) -> bool:
    """Returns whether a line surely keeps some clearance everywhere: fast, but it may miss a line.

    It goes from cell to cell of the grid (Amanatides and Woo, "A fast voxel traversal algorithm for
    ray tracing", Eurographics 1987). In a cell, the clearance is a parabola along the line. That is
    nowhere below the smaller of its ends by more than a quarter of its bend times the square of its
    length.

    Args:
        x: start of the line, m.
        y: the same.
        dx: end of the line relative to the start, m.
        dy: the same.
        need: clearance, m.
        ground: the free space; of a line that leaves it, nothing is sure.
    """
    grid, half, spacing = ground
    u, v, du, dv = (x + half[0]) / spacing, (y + half[1]) / spacing, dx / spacing, dy / spacing
    low_u, high_u, low_v, high_v = min(u, u + du), max(u, u + du), min(v, v + dv), max(v, v + dv)
    is_inside = low_u >= 0.0 and high_u <= grid.shape[1] - 1.001
    if not (is_inside and low_v >= 0.0 and high_v <= grid.shape[0] - 1.001):
        return False
    column, row = int(u), int(v)
    right, up = (1 if du >= 0.0 else -1), (1 if dv >= 0.0 else -1)
    share_u, share_v = 1.0 / max(abs(du), 1e-9), 1.0 / max(abs(dv), 1e-9)  # to cross a cell
    next_u = (column + 1 - u if du >= 0.0 else u - column) * share_u
    next_v = (row + 1 - v if dv >= 0.0 else v - row) * share_v
    share, free = 0.0, need + 1e-3
    while share < 1.0:
        end = min(next_u, next_v, 1.0)
        a, b = np.float64(grid[row, column]), np.float64(grid[row, column + 1])
        c, d = np.float64(grid[row + 1, column]), np.float64(grid[row + 1, column + 1])
        p, q, twist = u + end * du - column, v + end * dv - row, a - b - c + d
        at_end = a + p * (b - a) + q * (c - a) + p * q * twist
        sag = 0.25 * max(twist * du * dv, 0.0) * (end - share) * (end - share)
        if min(free, at_end) - sag < need + _ROUNDING:
            return False
        if next_u < next_v:
            column, next_u = column + right, next_u + share_u
        else:
            row, next_v = row + up, next_v + share_v
        share, free = end, at_end
    return True


@kernel(error_model="numpy")
def is_visible(
    start: tuple[float, float], end: tuple[float, float], need: float, ground: Ground
) -> bool:
    """Returns whether the straight line between two points keeps `need` metres of clearance.

    Where the start or the end has less clearance, that much is enough everywhere. Each step along
    the line is as long as the clearance beyond the need, at least half a spacing ("Sphere tracing",
    The Visual Computer 12, 1996, section 2). Outside the arena, from where robots that are out of
    reach start, nothing is in the way.
    """
    (x, y), (to_x, to_y) = start, end
    dx, dy = to_x - x, to_y - y
    length = math.sqrt(dx * dx + dy * dy)
    need = min(need, free_distance(x, y, ground) - 1e-3)
    need = min(need, free_distance(to_x, to_y, ground) - 1e-3)
    if is_clear(x, y, dx, dy, need, ground):
        return True
    outside = max(
        (abs(x) - ground.half[0]) / max(abs(dx), 1e-9),
        (abs(y) - ground.half[1]) / max(abs(dy), 1e-9),
    )  # share of the line before it enters the arena
    walked = max(outside, 0.0) * length
    while walked < length:
        share = walked / length
        free = free_distance(x + share * dx, y + share * dy, ground) - need
        if free < 0.0:
            return False
        walked += max(free, 0.5 * ground.spacing)
    return True


@kernel
def plan(x: float, y: float, weights: Int32, ground: Ground, paths: Paths) -> None:
    """Plans the paths of a robot from all nodes to the node nearest to a point that it can reach.

    Args:
        x: point, m.
        y: point, m.
        weights: of the nodes for the robot, `distance_field.weights_of`, [n].
        ground: the free space.
        paths: written.
    """
    costs, moves = paths
    end = nearest_node(x, y, weights, ground)
    if end < 0:
        costs[:] = -1
    else:
        fill_paths(end, ground.clearances.shape[1], weights, costs, moves)


@kernel
def position_of(node: int, ground: Ground) -> tuple[float, float]:
    """Returns the position of a node, m."""
    grid, half, spacing = ground
    columns = grid.shape[1]
    return (node % columns) * spacing - half[0], (node // columns) * spacing - half[1]


@kernel
def farthest_visible_node(
    position: tuple[float, float], need: float, ground: Ground, paths: Paths
) -> int:
    """Returns the farthest node of the path that is visible from a point, -1 if there is no path.

    Args:
        position: m.
        need: clearance that the straight line keeps, m.
        ground: the free space.
        paths: planned.
    """
    (costs, moves), columns = paths, ground.clearances.shape[1]
    node = nearest_node(position[0], position[1], costs, ground)
    if node < 0:
        return -1
    best = next_of(node, moves, columns)
    for hop in range(LOOKAHEAD_NODES):
        node = next_of(node, moves, columns)
        if hop % 2 == 1:
            if not is_visible(position, position_of(node, ground), need, ground):
                break
            best = node
    return int(best)


@kernel
def waypoint(
    position: tuple[float, float], goal: Double, radius: float, ground: Ground, paths: Paths
) -> tuple[float, float]:
    """Returns the point to aim at: the goal if visible, else the farthest visible node of the path.

    Args:
        position: m.
        goal: m, [2].
        radius: of the robot, m.
        ground: the free space.
        paths: to the goal; planned if they are not yet.

    Returns:
        The point, m; the goal if no path leads there.
    """
    need = radius + PATH_GAP
    if is_visible(position, (goal[0], goal[1]), need, ground):
        return goal[0], goal[1]
    if paths.costs[0] == UNPLANNED_COST:
        plan(goal[0], goal[1], weights_of(ground.clearances, radius), ground, paths)
    node = farthest_visible_node(position, need, ground, paths)
    return position_of(node, ground) if node >= 0 else (goal[0], goal[1])
