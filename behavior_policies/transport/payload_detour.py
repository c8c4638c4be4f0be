"""Paths of robots around a payload, over a graph of two rings of points that keep clear of it.

The outer ring passes behind robots that stand at the payload. Points are joined along their ring,
and to the point beside them on the other ring.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.behavior_policies.transport.push_setup import PayloadState
from swarmdata.numerics.distance_field import PATH_GAP, Ground
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.numerics.waypoints import free_distance, is_visible
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double

N_RING = 16  # points of a ring, four to a side

N_POINTS = 2 * N_RING

RING_GAPS = (0.06, 0.32)  # gaps (m) between payload and robot on the rings
PASSING_GAP = 0.02  # gap (m) that a path keeps from robots that stand at the payload
BLOCKED_TOLL = 1.0  # m, cost of a point or a line that a standing robot blocks
CLEAR_GAP = 0.01  # gap (m) that a straight line must keep for a robot to drive along it


class Rings(NamedTuple):
    """The points of both rings."""

    points: Double  # [N_POINTS, 2] m
    is_free: Bool  # [N_POINTS] where a robot has room


class Pushers(NamedTuple):
    """The robots of a team in one state."""

    robots: Double  # [N, C] positions first
    is_standing: Bool  # [N] at the payload, in their slots


@kernel
def crosses(
    payload: PayloadState, start: tuple[float, float], end: tuple[float, float], margin: float
) -> bool:
    """Whether a straight line meets the payload grown by `margin` metres on each side.

    A line that starts within the margin may lead away; one that ends within it crosses.
    """
    body, shape = payload
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
def fill_rings(payload: PayloadState, radius: float, ground: Ground, rings: Rings) -> None:
    """Writes the points of the rings, each counter-clockwise, and where a robot has room."""
    (body, shape), (points, is_free) = payload, rings
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
        is_free[n] = free_distance(points[n, 0], points[n, 1], ground) >= radius + PATH_GAP


@kernel
def _blocking_toll(
    i: int, pushers: Pushers, start: tuple[float, float], end: tuple[float, float], reach: float
) -> float:
    """`BLOCKED_TOLL` if robot i would come to touch a standing robot on a line, else 0."""
    robots, is_standing = pushers
    vx, vy = end[0] - start[0], end[1] - start[1]
    square = vx * vx + vy * vy
    for j in range(robots.shape[0]):
        if j == i or not is_standing[j]:
            continue
        px, py = start[0] - robots[j, 0], start[1] - robots[j, 1]
        t = 0.0 if square == 0.0 else min(max(-(px * vx + py * vy) / square, 0.0), 1.0)
        qx, qy = px + t * vx, py + t * vy
        if qx * qx + qy * qy < reach * reach and (t > 0.0 or square == 0.0):
            return BLOCKED_TOLL
    return 0.0


@kernel
def _relax(points: Double, tolls: Double, costs: Double) -> None:
    """Completes the costs of entering the points, m, each the cheapest over its three neighbors."""
    has_changed = True
    while has_changed:
        has_changed = False
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
                    has_changed = True


@kernel
def detour_waypoint(
    i: int,
    pushers: Pushers,  # the team
    end: tuple[float, float],  # m, a point beside the payload
    payload: PayloadState,
    radius: float,  # of the robots, m
    ground: Ground,  # the free space
    rings: Rings,  # from `fill_rings`
) -> tuple[bool, float, float]:
    """Whether robot i sees a point of its path to `end`, beside the payload, and that point, m."""
    (points, is_free), robots = rings, pushers.robots
    need, margin, reach = radius + PATH_GAP, radius + CLEAR_GAP, 2.0 * radius + PASSING_GAP
    position = (robots[i, 0], robots[i, 1])
    costs, tolls = np.full(N_POINTS, np.inf), np.full(N_POINTS, np.inf)
    for n in range(N_POINTS):
        point = (points[n, 0], points[n, 1])
        if not is_free[n]:
            continue
        tolls[n] = _blocking_toll(i, pushers, point, point, reach)
        if not crosses(payload, point, end, margin) and is_visible(point, end, need, ground):
            dx, dy = point[0] - end[0], point[1] - end[1]
            toll = _blocking_toll(i, pushers, point, end, reach)
            costs[n] = math.sqrt(dx * dx + dy * dy) + toll + tolls[n]
    _relax(points, tolls, costs)
    best, found, x, y = np.inf, False, position[0], position[1]
    for n in range(N_POINTS + 1):
        point, cost = end, 0.0
        if n < N_POINTS:
            point, cost = (points[n, 0], points[n, 1]), costs[n]
        dx, dy = point[0] - position[0], point[1] - position[1]
        cost += math.sqrt(dx * dx + dy * dy)
        if cost >= best or crosses(payload, position, point, margin):
            continue
        cost += _blocking_toll(i, pushers, position, point, reach)
        if cost < best and is_visible(position, point, need, ground):
            best, found, x, y = cost, True, point[0], point[1]
    return found, x, y
