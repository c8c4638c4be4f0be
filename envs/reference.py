"""The smooth path of a formation's reference: a uniform cubic B-spline over drawn control points.

Segment k of the path is made of control points k to k + 3 and takes `segment_time`. With the edges
of the control polygon e = p[k+1] - p[k], the path has three properties by construction (Farin,
"Curves and Surfaces for CAGD", 5th edition, 2002, chapter 8; its derivative is a quadratic
B-spline over e / segment_time):

- it stays in the convex hull of its control points, so within a box if they are;
- it is never faster than the longest edge / `segment_time`;
- position, velocity and acceleration are continuous; and since edges turn by less than a right
  angle, the velocity is never zero, so that the heading, its direction, is smooth too.

Polynomials and square roots only, so that the bits are the same on every platform.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from swarmdata.envs.spawn import TRIES, next_uniform
from swarmdata.types import Double, Float, Seeds

SHORTEST = 0.7
"""Shortest edge of a control polygon, as part of the longest: the reference changes its speed."""


class PathPlan(NamedTuple):
    """What drawing a path needs to know."""

    room: Double  # half width and half height of the box for control points, m, [2]
    n_points: int  # K
    longest: float  # edge, m
    tangent: float  # of half the largest turn from edge to edge
    rate: float  # segments per second
    reach: float  # m, from the reference to the farthest slot
    top: float  # m/s, speed that no slot may exceed


@njit(nogil=True, cache=True)
def spline(points: Float, s: float) -> tuple[float, float, float, float, float, float]:
    """Returns a path's position, and its first and second derivative by `s`.

    Args:
        points: control points x, y, x, y, ..., m, [2 K].
        s: segments from the start, at least 0; the last segment goes on.
    """
    k = min(int(s), points.shape[0] // 2 - 4)
    u = s - k
    v = 1.0 - u
    b0, b3 = v * v * v / 6.0, u * u * u / 6.0
    b1 = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    b2 = (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0
    c0, c2 = 0.5 * v * v, 0.5 * u * u
    c1 = 1.0 - c0 - c2
    i = 2 * k
    x0, x1 = float(points[i]), float(points[i + 2])
    x2, x3 = float(points[i + 4]), float(points[i + 6])
    y0, y1 = float(points[i + 1]), float(points[i + 3])
    y2, y3 = float(points[i + 5]), float(points[i + 7])
    return (
        b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3,
        b0 * y0 + b1 * y1 + b2 * y2 + b3 * y3,
        c0 * (x1 - x0) + c1 * (x2 - x1) + c2 * (x3 - x2),
        c0 * (y1 - y0) + c1 * (y2 - y1) + c2 * (y3 - y2),
        v * (x2 - 2.0 * x1 + x0) + u * (x3 - 2.0 * x2 + x1),
        v * (y2 - 2.0 * y1 + y0) + u * (y3 - 2.0 * y2 + y1),
    )


@njit(nogil=True, cache=True)
def write_pose(points: Float, s: float, out: Float | Double) -> None:
    """Writes position (m) and heading (unit vector) of the reference, [4]."""
    x, y, dx, dy, _, _ = spline(points, s)
    norm = math.sqrt(dx * dx + dy * dy)
    out[0], out[1], out[2], out[3] = x, y, dx / norm, dy / norm


@njit(nogil=True, cache=True)
def write_motion(points: Float, s: float, rate: float, out: Float | Double) -> None:
    """Writes position (m), velocity (m/s), heading and turn rate (rad/s), [7].

    The turn rate is that of the velocity's direction, (v x a) / |v|^2.
    """
    x, y, dx, dy, ddx, ddy = spline(points, s)
    square = dx * dx + dy * dy
    norm = math.sqrt(square)
    out[0], out[1], out[2], out[3] = x, y, dx * rate, dy * rate
    out[4], out[5] = dx / norm, dy / norm
    out[6] = (dx * ddy - dy * ddx) / square * rate


@njit(nogil=True, cache=True)
def draw_path(state: Seeds, plan: PathPlan, points: Float) -> bool:
    """Draws a path whose slots are never too fast; False if a control point found no place.

    Args:
        state: of the generator, [1].
        plan: the same for every episode.
        points: written, control points x, y, x, y, ..., m, [2 K].
    """
    t = 2.0 * next_uniform(state) - 1.0
    sign = 1.0 if next_uniform(state) < 0.5 else -1.0
    ux, uy = sign * (1.0 - t * t) / (1.0 + t * t), sign * 2.0 * t / (1.0 + t * t)
    points[0] = plan.room[0] * (2.0 * next_uniform(state) - 1.0)
    points[1] = plan.room[1] * (2.0 * next_uniform(state) - 1.0)
    for k in range(1, plan.n_points):
        for attempt in range(TRIES + 1):
            if attempt == TRIES:
                return False
            t = plan.tangent * (2.0 * next_uniform(state) - 1.0)
            edge = plan.longest * (SHORTEST + (1.0 - SHORTEST) * next_uniform(state))
            cos, sin = (1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t)
            wx, wy = ux * cos - uy * sin, ux * sin + uy * cos
            x, y = float(points[2 * k - 2]) + edge * wx, float(points[2 * k - 1]) + edge * wy
            if abs(x) > plan.room[0] or abs(y) > plan.room[1]:
                continue
            points[2 * k], points[2 * k + 1] = x, y
            if k < 3 or is_slow(points[2 * k - 6 : 2 * k + 2], plan):
                break
        ux, uy = wx, wy
    return True


@njit(nogil=True, cache=True)
def is_slow(points: Float, plan: PathPlan) -> bool:
    """Whether no slot exceeds its speed on one segment, [8], looked at in five places."""
    motion = np.empty(7)
    for quarter in range(5):
        write_motion(points, 0.25 * quarter, plan.rate, motion)
        speed = math.sqrt(motion[2] * motion[2] + motion[3] * motion[3])
        if speed + abs(motion[6]) * plan.reach > plan.top:
            return False
    return True
