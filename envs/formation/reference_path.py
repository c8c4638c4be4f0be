"""The smooth path of a formation's reference: a uniform cubic B-spline over drawn control points.

Segment k depends on control points k to k + 3 and takes `segment_time`. With the edges
e = p[k+1] - p[k] of the control polygon (Farin, "Curves and Surfaces for CAGD", 5th edition, 2002,
chapter 8; its derivative is a quadratic B-spline over e / segment_time), the path

- stays in the convex hull of its control points, and so in any box that contains them;
- is never faster than the longest edge / `segment_time`;
- has continuous position, velocity and acceleration. Edges turn by less than a right angle, so the
  velocity is never zero, and its direction, the heading, is smooth too.

It uses only polynomials and square roots, so that the bits are the same on every platform.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.envs.world.spawn import next_uniform, unit_vector
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float, Seeds

ONE_SIXTH = 1.0 / 6.0

EDGE_TRIES = 8  # attempts to draw an edge before the walk takes the next edge of a loop
MIN_EDGE_SHARE = 0.7  # shortest edge over the longest; they vary the reference's speed


class PathPlan(NamedTuple):
    """The constants of a spec's paths."""

    room: Double  # half width and half height of the box for control points, m, [2]
    n_points: int  # K
    longest: float  # longest edge, m
    tangent: float  # tangent of half the largest turn between edges
    n_loop: int  # edges of a loop with such turns
    rate: float  # segments per second
    reach: float  # distance from the reference to the farthest slot, m
    top: float  # largest speed of a slot, m/s


@kernel(inline="always")
def spline(row: Float, first: int, s: float) -> tuple[float, float, float, float, float, float]:
    """Returns a path's position (m), and its first and second derivative by `s`.

    `row` [first + 2 K] ends with the control points x, y, x, y, ..., m. `s`: segments from the
    start, at least 0; beyond the end, the last segment is extrapolated.
    """
    k = min(int(s), (row.shape[0] - first) // 2 - 4)
    u = s - k
    v = 1.0 - u
    c0, c2 = 0.5 * v * v, 0.5 * u * u
    c1 = 1.0 - c0 - c2
    b0, b3 = ONE_SIXTH * v * v * v, ONE_SIXTH * u * u * u
    b2 = ONE_SIXTH + 0.5 * u * (1.0 + u * v)
    b1 = 1.0 - b0 - b2 - b3
    i = first + 2 * k
    x0, x1, x2 = float(row[i]), float(row[i + 2]), float(row[i + 4])
    y0, y1, y2 = float(row[i + 1]), float(row[i + 3]), float(row[i + 5])
    x3, y3 = float(row[i + 6]), float(row[i + 7])
    return (
        b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3,
        b0 * y0 + b1 * y1 + b2 * y2 + b3 * y3,
        c0 * (x1 - x0) + c1 * (x2 - x1) + c2 * (x3 - x2),
        c0 * (y1 - y0) + c1 * (y2 - y1) + c2 * (y3 - y2),
        v * (x2 - 2.0 * x1 + x0) + u * (x3 - 2.0 * x2 + x1),
        v * (y2 - 2.0 * y1 + y0) + u * (y3 - 2.0 * y2 + y1),
    )


@kernel
def write_pose(row: Float, first: int, s: float, out: Float | Double, at: int) -> None:
    """Writes position (m) and heading (unit vector) of the reference to `out[at : at + 4]`.

    Other arguments are those of `spline`.
    """
    x, y, dx, dy, _, _ = spline(row, first, s)
    scale = 1.0 / math.sqrt(dx * dx + dy * dy)
    out[at], out[at + 1], out[at + 2], out[at + 3] = x, y, dx * scale, dy * scale


@kernel
def write_motion(
    row: Float, first: int, s: float, rate: float, out: Float | Double, at: int
) -> None:
    """Writes position (m), velocity (m/s), heading and turn rate (rad/s), 7 numbers.

    The turn rate is that of the velocity's direction, (v x a) / |v|^2. Arguments are those of
    `write_pose`; `rate`: segments per second.
    """
    x, y, dx, dy, ddx, ddy = spline(row, first, s)
    square = dx * dx + dy * dy
    scale = 1.0 / math.sqrt(square)
    out[at], out[at + 1], out[at + 2], out[at + 3] = x, y, dx * rate, dy * rate
    out[at + 4], out[at + 5] = dx * scale, dy * scale
    out[at + 6] = (dx * ddy - dy * ddx) / square * rate


@kernel
def draw_path(state: Seeds, plan: PathPlan, points: Float) -> bool:
    """Draws a path on which no slot is too fast; returns False if it found none.

    This random walk in the box never gets stuck: after every edge, a loop of the sharpest turns to
    one side still fits. Where no random edge does, the walk takes the loop's next edge. `state`: of
    the generator, [1]. `points`: written, control points x, y, x, y, ..., m, [2 K].
    """
    points[0] = plan.room[0] * (2.0 * next_uniform(state) - 1.0)
    points[1] = plan.room[1] * (2.0 * next_uniform(state) - 1.0)
    ux, uy = unit_vector(2.0 * next_uniform(state) - 1.0)
    if next_uniform(state) < 0.5:
        ux, uy = -ux, -uy
    for k in range(1, plan.n_points):
        for attempt in range(EDGE_TRIES + 3):
            if attempt == EDGE_TRIES + 2:
                return False
            t = plan.tangent * (2.0 * next_uniform(state) - 1.0)
            edge = plan.longest * (MIN_EDGE_SHARE + (1.0 - MIN_EDGE_SHARE) * next_uniform(state))
            if attempt >= EDGE_TRIES:
                t = plan.tangent if attempt == EDGE_TRIES else -plan.tangent
                edge = MIN_EDGE_SHARE * plan.longest
            wx, wy = turned(ux, uy, t)
            x, y = float(points[2 * k - 2]) + edge * wx, float(points[2 * k - 1]) + edge * wy
            rest = min(plan.n_points - 1 - k, plan.n_loop)
            if not (fits(x, y, wx, wy, plan, rest, 1.0) or fits(x, y, wx, wy, plan, rest, -1.0)):
                continue
            points[2 * k], points[2 * k + 1] = x, y
            if k < 3 or is_slow(points[2 * k - 6 : 2 * k + 2], plan):
                break
        ux, uy = wx, wy
    return True


@kernel
def fits(
    x: float, y: float, ux: float, uy: float, plan: PathPlan, n_edges: int, side: float
) -> bool:
    """Whether a point (m), and the shortest edges with the sharpest turns after it, are in the box.

    (ux, uy) is the direction of the edge that led to it; `side`: 1 to turn left, -1 to turn right.
    """
    edge = MIN_EDGE_SHARE * plan.longest
    for _ in range(n_edges):
        if abs(x) > plan.room[0] or abs(y) > plan.room[1]:
            return False
        ux, uy = turned(ux, uy, side * plan.tangent)
        x, y = x + edge * ux, y + edge * uy
    return abs(x) <= plan.room[0] and abs(y) <= plan.room[1]


@kernel(inline="always")
def turned(ux: float, uy: float, t: float) -> tuple[float, float]:
    """Turns a unit vector by twice the angle of tangent t."""
    cos, sin = unit_vector(t)
    return ux * cos - uy * sin, ux * sin + uy * cos


@kernel
def is_slow(points: Float, plan: PathPlan) -> bool:
    """Whether no slot is too fast in five places of one segment, given its control points, [8]."""
    motion = np.empty(7)
    for quarter in range(5):
        write_motion(points, 0, 0.25 * quarter, plan.rate, motion, 0)
        speed = math.sqrt(motion[2] * motion[2] + motion[3] * motion[3])
        if speed + abs(motion[6]) * plan.reach > plan.top:
            return False
    return True
