"""The way of a robot around a payload, over a graph of two rings of points that keep clear of it.

The inner ring is close to the payload, the outer one passes behind robots that stand at it. Points
are joined along their ring, and to the point beside them on the other ring.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.distance_field import MARGIN
from swarmdata.behavior_policies.navigation.planner import free_distance, is_visible
from swarmdata.envs.transport.payload import Shape
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double, Float

N_RING = 16
"""Points of a ring, four to a side."""

N_POINTS = 2 * N_RING

RING_GAPS = (0.06, 0.32)
"""Gaps (m) between payload and robot on the rings."""

PASS = 0.02
"""Gap (m) that a way keeps from robots that stand at the payload."""

BUSY = 1.0
"""Metres that a point or a line counts for beside its length where a robot stands in its way."""

CLEAR_GAP = 0.01
"""Gap (m) that a straight line must keep for a robot to drive along it."""


@kernel
def crosses(
    body: Double, shape: Shape, start: tuple[float, float], end: tuple[float, float], margin: float
) -> bool:
    """Whether a straight line meets the payload grown by `margin` metres on each side.

    A line that starts within the margin may run away from the payload; one that ends within it,
    beyond a corner of a box too, crosses.

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


@kernel
def fill_rings(
    body: Double,
    shape: Shape,
    radius: float,
    ground: tuple[Float, Double],
    points: Double,
    free: Bool,
) -> None:
    """Writes the points of the rings, each counter-clockwise, and where a robot has room.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload; the rings of a circle come from its square.
        radius: of the robots, m.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        points: written, m, [N_POINTS, 2].
        free: written, [N_POINTS].
    """
    for n in range(N_POINTS):
        k, gap = n % N_RING, RING_GAPS[n // N_RING]
        a, b = shape[1] + radius + gap, shape[2] + radius + gap
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
        points[n, 0] = body[0] + x * body[4] - y * body[5]
        points[n, 1] = body[1] + x * body[5] + y * body[4]
        clear = free_distance(points[n, 0], points[n, 1], ground[0], ground[1])
        free[n] = clear >= radius + MARGIN


@kernel
def _hindrance(
    start: tuple[float, float],
    end: tuple[float, float],
    i: int,
    robots: Double,
    standing: Bool,
    reach: float,
) -> float:
    """`BUSY` if robot i would touch a standing robot on a straight line, else 0.

    A robot that it already touches does not count, so that it can leave.
    """
    vx, vy = end[0] - start[0], end[1] - start[1]
    square = vx * vx + vy * vy
    for j in range(robots.shape[0]):
        if j == i or not standing[j]:
            continue
        px, py = start[0] - robots[j, 0], start[1] - robots[j, 1]
        t = 0.0 if square == 0.0 else min(max(-(px * vx + py * vy) / square, 0.0), 1.0)
        qx, qy = px + t * vx, py + t * vy
        if qx * qx + qy * qy < reach * reach and (t > 0.0 or square == 0.0):
            return BUSY
    return 0.0


@kernel
def _relax(points: Double, tolls: Double, costs: Double) -> None:
    """Completes the costs of the points: each is the cheapest over its three neighbors.

    Args:
        points: m, [N_POINTS, 2].
        tolls: what entering a point costs beside the way, m, infinite where a robot cannot be,
            [N_POINTS].
        costs: read and written, m, [N_POINTS].
    """
    again = True
    while again:
        again = False
        for n in range(N_POINTS):
            first, k = n - n % N_RING, n % N_RING
            for step in range(3):
                near = (n + N_RING) % N_POINTS
                if step < 2:
                    near = first + (k + 1 - 2 * step) % N_RING
                dx, dy = points[near, 0] - points[n, 0], points[near, 1] - points[n, 1]
                cost = costs[near] + math.sqrt(dx * dx + dy * dy) + tolls[n]
                if cost < costs[n] - 1e-9:
                    costs[n] = cost
                    again = True


@kernel
def way_around(
    body: Double,
    shape: Shape,
    i: int,
    end: tuple[float, float],
    radius: float,
    ground: tuple[Float, Double],
    rings: tuple[Double, Bool],
    team: tuple[Double, Bool],
) -> tuple[bool, float, float]:
    """Returns the next point of a robot's way to `end`, around the payload.

    Args:
        body: columns `states.BODY`, [7].
        shape: of the payload.
        i: which robot.
        end: a point beside the payload, m.
        radius: of the robots, m.
        ground: clearances, m, [rows, columns]; half width and half height of the arena, m, [2].
        rings: from `fill_rings`, [N_POINTS, 2] and [N_POINTS].
        team: robots, positions first, [N, any], and which of them stand at the payload, [N].

    Returns:
        Whether there is one that the robot sees, and the point, m.
    """
    (points, free), (robots, standing), (grid, half) = rings, team, ground
    need, margin, reach = radius + MARGIN, radius + CLEAR_GAP, 2.0 * radius + PASS
    position = (robots[i, 0], robots[i, 1])
    costs, tolls = np.full(N_POINTS, np.inf), np.full(N_POINTS, np.inf)
    for n in range(N_POINTS):
        to = (points[n, 0], points[n, 1])
        if not free[n]:
            continue
        tolls[n] = _hindrance(to, to, i, robots, standing, reach)
        if not crosses(body, shape, to, end, margin) and is_visible(
            to[0], to[1], end[0], end[1], need, grid, half
        ):
            dx, dy = to[0] - end[0], to[1] - end[1]
            toll = _hindrance(to, end, i, robots, standing, reach)
            costs[n] = math.sqrt(dx * dx + dy * dy) + toll + tolls[n]
    _relax(points, tolls, costs)
    best, found, x, y = np.inf, False, position[0], position[1]
    for n in range(N_POINTS + 1):
        to, cost = end, 0.0
        if n < N_POINTS:
            to, cost = (points[n, 0], points[n, 1]), costs[n]
        dx, dy = to[0] - position[0], to[1] - position[1]
        cost += math.sqrt(dx * dx + dy * dy)
        if cost >= best or crosses(body, shape, position, to, margin):
            continue
        cost += _hindrance(position, to, i, robots, standing, reach)
        if cost < best and is_visible(position[0], position[1], to[0], to[1], need, grid, half):
            best, found, x, y = cost, True, to[0], to[1]
    return found, x, y
