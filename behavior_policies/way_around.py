"""The way of a robot around a payload, along a ring of points that keeps clear of it.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np
from numba import njit

from swarmdata.behavior_policies.distance_field import MARGIN
from swarmdata.behavior_policies.planner import free_distance, is_visible
from swarmdata.envs.payload import Shape
from swarmdata.geometry import CIRCLE
from swarmdata.types import Bool, Double, Float

N_RING = 16
"""Points of the ring, four to a side."""

RING_GAP = 0.06
"""Gap (m) between payload and robot on the ring."""

CLEAR_GAP = 0.01
"""Gap (m) that a straight line must keep for a robot to drive along it."""


@njit(nogil=True, cache=True)
def crosses(
    body: Double, shape: Shape, start: tuple[float, float], end: tuple[float, float], margin: float
) -> bool:
    """Whether a straight line meets the payload grown by `margin` metres on each side.

    A line that starts or ends within the margin may run away from the payload.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        start: m.
        end: m.
        margin: m.
    """
    ux, uy = body[4], body[5]
    ax, ay = start[0] - body[0], start[1] - body[1]
    dx, dy = end[0] - start[0], end[1] - start[1]
    px, py, vx, vy = ax * ux + ay * uy, ay * ux - ax * uy, dx * ux + dy * uy, dy * ux - dx * uy
    if shape[0] == CIRCLE:
        square = vx * vx + vy * vy
        t = 0.0 if square == 0.0 else min(max(-(px * vx + py * vy) / square, 0.0), 1.0)
        qx, qy = px + t * vx, py + t * vy
        reach = min(shape[1] + margin, math.sqrt(px * px + py * py) - 1e-6)
        return qx * qx + qy * qy < reach * reach
    low, high = 0.0, 1.0
    outside = max(abs(px) - shape[1], abs(py) - shape[2])
    margin = min(margin, outside - 1e-6)
    for p, v, extent in ((px, vx, shape[1] + margin), (py, vy, shape[2] + margin)):
        if abs(v) < 1e-12:
            if abs(p) >= extent:
                return False
            continue
        t, s = (-extent - p) / v, (extent - p) / v
        low, high = max(low, min(t, s)), min(high, max(t, s))
    return low < high


@njit(nogil=True, cache=True)
def fill_ring(
    body: Double,
    shape: Shape,
    radius: float,
    ground: tuple[Float, Double],
    points: Double,
    free: Bool,
) -> None:
    """Writes the points of the ring, counter-clockwise, and where a robot has room.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload; the ring of a circle is its square.
        radius: of the robots, m.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        points: written, m, [N_RING, 2].
        free: written, [N_RING].
    """
    a, b = shape[1] + radius + RING_GAP, shape[2] + radius + RING_GAP
    for k in range(N_RING):
        side, share = k // 4, 0.5 * (k % 4) - 1.0
        if side == 0:
            x, y = a, b * share
        elif side == 1:
            x, y = -a * share, b
        elif side == 2:
            x, y = -a, -b * share
        else:
            x, y = a * share, -b
        if shape[0] == CIRCLE:
            scale = a / math.sqrt(x * x + y * y)
            x, y = x * scale, y * scale
        points[k, 0] = body[0] + x * body[4] - y * body[5]
        points[k, 1] = body[1] + x * body[5] + y * body[4]
        gap = free_distance(points[k, 0], points[k, 1], ground[0], ground[1])
        free[k] = gap >= radius + MARGIN


@njit(nogil=True, cache=True)
def _ring_costs(points: Double, free: Bool, end: tuple[float, float], costs: Double) -> None:
    """Writes the length of the shorter free way along the ring from each point to `end`, m."""
    last, best = 0, 1e9
    for k in range(N_RING):
        dx, dy = end[0] - points[k, 0], end[1] - points[k, 1]
        if free[k] and dx * dx + dy * dy < best:
            last, best = k, dx * dx + dy * dy
    costs[:] = np.inf
    if best == 1e9:
        return
    for turn in (1, -1):
        cost, k = math.sqrt(best), last
        while free[k] and cost < costs[k] + 1e-12:
            costs[k] = cost
            near = (k + turn) % N_RING
            dx, dy = points[near, 0] - points[k, 0], points[near, 1] - points[k, 1]
            cost, k = cost + math.sqrt(dx * dx + dy * dy), near
            if k == last:
                break


@njit(nogil=True, cache=True)
def way_around(
    body: Double,
    shape: Shape,
    position: tuple[float, float],
    end: tuple[float, float],
    radius: float,
    ground: tuple[Float, Double],
    ring: tuple[Double, Bool],
) -> tuple[bool, float, float]:
    """Returns the next point of a robot's way to `end`, around the payload.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        position: of the robot, m.
        end: a point beside the payload, m.
        radius: of the robot, m.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        ring: from `fill_ring`.

    Returns:
        Whether there is one that the robot sees, and the point, m.
    """
    grid, half = ground
    need, margin = radius + MARGIN, radius + CLEAR_GAP
    x, y = position
    if not crosses(body, shape, position, end, margin) and is_visible(
        x, y, end[0], end[1], need, grid, half
    ):
        return True, end[0], end[1]
    costs = np.empty(N_RING)
    _ring_costs(ring[0], ring[1], end, costs)
    best, found = np.inf, -1
    for k in range(N_RING):
        to = (ring[0][k, 0], ring[0][k, 1])
        dx, dy = to[0] - x, to[1] - y
        cost = costs[k] + math.sqrt(dx * dx + dy * dy)
        if cost >= best or crosses(body, shape, position, to, margin):
            continue
        if is_visible(x, y, to[0], to[1], need, grid, half):
            best, found = cost, k
    if found < 0:
        return False, x, y
    return True, ring[0][found, 0], ring[0][found, 1]
