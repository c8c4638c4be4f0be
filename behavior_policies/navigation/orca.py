"""Optimal reciprocal collision avoidance: half-planes of safe velocities, and the best one in all.

Source: van den Berg, Guy, Lin and Manocha, "Reciprocal n-body collision avoidance", ISRR 2011:
half-planes from sections 4 and 5.1, the linear programs from sections 5.2 and 5.3, which follow
de Berg et al., "Computational Geometry", chapter 4 (incremental, without the random order).

A row (px, py, dx, dy) of `planes` [K, 4] is a half-plane: the velocities on or left of the line
through (px, py) with unit direction (dx, dy). The first n rows count, of which the first n_hard
must hold. `limit` is the largest speed, m/s; `aim` the velocity to approximate, or, with
`is_direction`, the unit direction in which the velocity is to be largest.
"""

import math

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

PARALLEL_TOLERANCE = 1e-9  # unit directions whose determinant is below this count as parallel


@kernel
def robot_half_plane(
    offset: tuple[float, float],  # of the other robot from this one, m
    velocity: tuple[float, float],  # of this robot, m/s
    other: tuple[float, float],  # of the other robot, m/s
    reach: float,  # distance of centres to keep, m
    rule: tuple[float, float, float],  # horizon, s; time to end an overlap, s; own share
    out: Double,  # [4] written
) -> None:
    """Writes the velocities that avoid another robot for the horizon (paper, section 4).

    The share, of the correction, is 1/2 where both robots do the same.
    """
    horizon, recovery, share = rule
    x, y = offset
    vx, vy = velocity[0] - other[0], velocity[1] - other[1]
    square = x * x + y * y
    overlapping = square <= reach * reach
    horizon = recovery if overlapping else horizon
    wx, wy = vx - x / horizon, vy - y / horizon
    along = wx * x + wy * y
    speed = math.sqrt(wx * wx + wy * wy)
    if overlapping or (along < 0.0 and along * along > reach * reach * speed * speed):
        if (
            speed < PARALLEL_TOLERANCE
        ):  # exactly at the centre of the cut-off circle: leave it backwards
            distance = max(math.sqrt(square), PARALLEL_TOLERANCE)
            ux, uy = -x / distance, -y / distance
        else:
            ux, uy = wx / speed, wy / speed
        correction = reach / horizon - speed
        out[2], out[3] = uy, -ux
        cx, cy = correction * ux, correction * uy
    else:
        leg = math.sqrt(square - reach * reach)
        if x * wy - y * wx > 0.0:
            dx, dy = (x * leg - y * reach) / square, (x * reach + y * leg) / square
        else:
            dx, dy = -(x * leg + y * reach) / square, -(y * leg - x * reach) / square
        slide = vx * dx + vy * dy
        out[2], out[3] = dx, dy
        cx, cy = slide * dx - vx, slide * dy - vy
    out[0], out[1] = velocity[0] + share * cx, velocity[1] + share * cy


@kernel
def damper_half_plane(nx: float, ny: float, bound: float, out: Double) -> None:
    """Writes the velocities of at most `bound` m/s along the unit vector (nx, ny), [4].

    The vector points to an obstacle; a negative bound means to back off.
    """
    out[0], out[1], out[2], out[3] = nx * bound, ny * bound, -ny, nx


@kernel
def _outside(plane: Double, vx: float, vy: float) -> float:
    """How far a velocity is outside a half-plane, m/s; negative inside."""
    return float(plane[2] * (plane[1] - vy) - plane[3] * (plane[0] - vx))


@kernel
def best_on_line(
    planes: Double, k: int, limit: float, aim: tuple[float, float], is_direction: bool
) -> tuple[bool, float, float]:
    """Whether a velocity on the border of half-plane k is within those before; the best, m/s."""
    px, py, dx, dy = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
    middle = px * dx + py * dy
    room = middle * middle + limit * limit - (px * px + py * py)
    if room < 0.0:
        return False, 0.0, 0.0
    root = math.sqrt(room)
    low, high = -middle - root, -middle + root
    for i in range(k):
        cross = dx * planes[i, 3] - dy * planes[i, 2]
        offset = planes[i, 2] * (py - planes[i, 1]) - planes[i, 3] * (px - planes[i, 0])
        if abs(cross) <= PARALLEL_TOLERANCE:
            if offset < -PARALLEL_TOLERANCE:
                return False, 0.0, 0.0
            continue
        t = offset / cross
        if cross >= 0.0:
            high = min(high, t)
        else:
            low = max(low, t)
        if low > high:
            return False, 0.0, 0.0
    if is_direction:
        t = high if aim[0] * dx + aim[1] * dy > 0.0 else low
    else:
        t = min(max(dx * (aim[0] - px) + dy * (aim[1] - py), low), high)
    return True, px + t * dx, py + t * dy


@kernel
def best_velocity(
    planes: Double, n: int, limit: float, aim: tuple[float, float], is_direction: bool
) -> tuple[int, float, float]:
    """Returns the velocity in all half-planes that is nearest to `aim` (paper, section 5.2).

    Before it, the index of the first half-plane that cannot be satisfied, or n; the velocity is
    then the best one for those before.
    """
    vx, vy = aim
    square = vx * vx + vy * vy
    if is_direction:
        vx, vy = vx * limit, vy * limit
    elif square > limit * limit:
        norm = math.sqrt(square)
        vx, vy = vx / norm * limit, vy / norm * limit
    for k in range(n):
        if _outside(planes[k], vx, vy) > 0.0:
            found, new_x, new_y = best_on_line(planes, k, limit, aim, is_direction)
            if not found:
                return k, vx, vy
            vx, vy = new_x, new_y
    return n, vx, vy


@kernel
def least_violating(
    planes: Double, n: int, n_hard: int, first: int, limit: float, start: tuple[float, float]
) -> tuple[float, float]:
    """Returns the velocity with the least violation of any soft half-plane (paper, section 5.3).

    `first`, `start`: where `best_velocity` failed, and the velocity that it returned.
    """
    vx, vy = start
    worst = 0.0
    projected = np.empty((n, 4))
    for k in range(first, n):
        if _outside(planes[k], vx, vy) <= worst:
            continue
        count = min(n_hard, k)
        for i in range(count):
            for c in range(4):
                projected[i, c] = planes[i, c]
        for i in range(n_hard, k):
            if _bisector(planes[k], planes[i], projected[count]):
                count += 1
        outward = (-planes[k, 3], planes[k, 2])
        failed, new_x, new_y = best_velocity(projected, count, limit, outward, True)
        if failed == count:  # only rounding makes it fail: then keep the velocity
            vx, vy = new_x, new_y
        worst = _outside(planes[k], vx, vy)
    return vx, vy


@kernel
def _bisector(k: Double, i: Double, out: Double) -> bool:
    """Writes where half-plane i is violated no more than k; False if they point the same way."""
    cross = k[2] * i[3] - k[3] * i[2]
    if abs(cross) <= PARALLEL_TOLERANCE:
        if k[2] * i[2] + k[3] * i[3] > 0.0:
            return False
        out[0], out[1] = 0.5 * (k[0] + i[0]), 0.5 * (k[1] + i[1])
    else:
        t = (i[2] * (k[1] - i[1]) - i[3] * (k[0] - i[0])) / cross
        out[0], out[1] = k[0] + t * k[2], k[1] + t * k[3]
    dx, dy = i[2] - k[2], i[3] - k[3]
    norm = math.sqrt(dx * dx + dy * dy)
    out[2], out[3] = dx / norm, dy / norm
    return True


@kernel
def solve(
    planes: Double, n: int, n_hard: int, limit: float, aim: tuple[float, float]
) -> tuple[float, float]:
    """Returns the safe velocity (m/s) nearest to `aim`; if there is none, the least unsafe one."""
    failed, vx, vy = best_velocity(planes, n, limit, aim, False)
    if failed < n:
        vx, vy = least_violating(planes, n, n_hard, failed, limit, (vx, vy))
    return vx, vy
