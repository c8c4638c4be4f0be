"""Waypoints: the farthest point of a robot's path that it can reach in a straight line."""

import math
from typing import NamedTuple

from swarmdata.numerics.distance_field import (
    PATH_GAP,
    Ground,
    Int32,
    fill_paths,
    nearest_node,
    weights_of,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

LOOKAHEAD_NODES = 40
"""Nodes of the path that are searched for a visible one: 2 to 2.8 m with a spacing of 0.05 m."""

UNPLANNED_COST = -2
"""Cost of node 0, which lies in a wall, until the goal is out of sight and paths are planned."""


class Paths(NamedTuple):
    """The cheapest paths from all nodes to one goal."""

    costs: Int32  # [n] -1 where there is no path; costs[0] is `UNPLANNED_COST` before planning
    next_nodes: Int32  # [n] on the path


@kernel
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


@kernel
def is_visible(
    start: tuple[float, float], end: tuple[float, float], need: float, ground: Ground
) -> bool:
    """Returns whether the straight line between two points keeps `need` metres of clearance.

    Where the start or the end has less clearance, that much is enough everywhere. Each step along
    the line is as long as the clearance beyond the need, at least half a spacing ("Sphere tracing",
    The Visual Computer 12, 1996, section 2). Outside the arena nothing is in the way.
    """
    (x, y), (to_x, to_y) = start, end
    dx, dy = to_x - x, to_y - y
    length = math.sqrt(dx * dx + dy * dy)
    need = min(need, free_distance(x, y, ground) - 1e-3)
    need = min(need, free_distance(to_x, to_y, ground) - 1e-3)
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
def plan(x: float, y: float, radius: float, ground: Ground, paths: Paths) -> None:
    """Plans the paths of a robot from all nodes to the reachable node nearest to a point."""
    costs, next_nodes = paths
    weights = weights_of(ground.clearances, radius)
    end = nearest_node(x, y, weights - 1, ground)
    if end < 0:
        costs[:] = -1
    else:
        fill_paths(end, ground.clearances.shape[1], weights, costs, next_nodes)


@kernel
def position_of(node: int, ground: Ground) -> tuple[float, float]:
    """Returns the position of a node, m."""
    grid, half, spacing = ground
    columns = grid.shape[1]
    return (node % columns) * spacing - half[0], (node // columns) * spacing - half[1]


@kernel
def farthest_visible_node(
    position: tuple[float, float],  # m
    need: float,  # clearance that the straight line keeps, m
    ground: Ground,  # the free space
    paths: Paths,  # planned
) -> int:
    """Returns the farthest node of the path visible from a point, -1 if there is no path."""
    costs, next_nodes = paths
    node = nearest_node(position[0], position[1], costs, ground)
    if node < 0:
        return -1
    best = next_nodes[node]
    for hop in range(LOOKAHEAD_NODES):
        node = next_nodes[node]
        if hop % 2 == 1:
            if not is_visible(position, position_of(node, ground), need, ground):
                break
            best = node
    return int(best)


@kernel
def waypoint(
    position: tuple[float, float],  # m
    goal: Double,  # [2] m
    radius: float,  # of the robot, m
    ground: Ground,  # the free space
    paths: Paths,  # to the goal; planned if they are not yet
) -> tuple[float, float]:
    """Returns the point to aim at, m: the farthest visible node of the path to the goal.

    It is the goal itself if that is visible, or if no path leads there.
    """
    need = radius + PATH_GAP
    if is_visible(position, (goal[0], goal[1]), need, ground):
        return goal[0], goal[1]
    if paths.costs[0] == UNPLANNED_COST:
        plan(goal[0], goal[1], radius, ground, paths)
    node = farthest_visible_node(position, need, ground, paths)
    return position_of(node, ground) if node >= 0 else (goal[0], goal[1])
