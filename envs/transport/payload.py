"""Gaps between a payload, a row of a layout that moves, and robots, obstacles and walls."""

import math

import numpy as np

from swarmdata.numerics.geometry import BOX, CIRCLE, bar_box, bounding_radius, nearest, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload
from swarmdata.types import Double, Float

Shape = tuple[float, float, float]
"""Shape code, half length and half width (m; both the radius of a circle). A plain tuple, since a
named one makes a kernel's call 0.4 us slower, and every step makes two."""

CONTACT_GAP = 0.01  # m up to which gaps count as contact: one at rest jitters by so much


def shape_of(payload: Payload) -> Shape:
    """Returns the payload's shape for kernels."""
    if payload.shape == "circle":
        return CIRCLE, payload.half_length, payload.half_length
    return BOX, payload.half_length, payload.half_width


def payload_radius(payload: Payload) -> float:
    """Returns the radius (m) of the smallest circle around its centre that contains the payload."""
    if payload.shape == "circle":
        return payload.half_length
    return math.sqrt(payload.half_length**2 + payload.half_width**2)


@kernel(inline="always")
def place_row(body: Float, shape: Shape, row: Float) -> None:
    """Writes the payload, `body` [7], as a row of a layout, [8]."""
    row[0], row[5], row[6] = shape
    row[1], row[2], row[3], row[4], row[7] = body[0], body[1], body[4], body[5], 0.0


@kernel
def _corner(row: Float, bar: int, k: int) -> tuple[float, float]:
    """Corner k of a bar of an obstacle; bars are counted as in `geometry.bar_box`."""
    a, b, t = np.float64(row[5]), np.float64(row[6]), np.float64(row[7])
    cx, cy, hx, hy = bar_box(row[0], a, b, t, bar)
    lx, ly = cx + (hx if k % 2 == 0 else -hx), cy + (hy if k < 2 else -hy)
    ux, uy = np.float64(row[3]), np.float64(row[4])
    return np.float64(row[1]) + lx * ux - ly * uy, np.float64(row[2]) + lx * uy + ly * ux


@kernel
def obstacle_gap(row: Float, obstacle: Float) -> float:
    """Gap (m) between a payload and an obstacle, rows [8] of layouts, 0 where they overlap.

    Exact while the overlap is shallow: of two convex shapes that are apart or just touch, one of
    the nearest points is a corner, or lies on a circle, whose centre is tested instead.
    """
    if row[0] == CIRCLE:
        return max(
            nearest(np.float64(row[1]), np.float64(row[2]), obstacle)[0] - np.float64(row[5]), 0.0
        )
    if obstacle[0] == CIRCLE:
        d = nearest(np.float64(obstacle[1]), np.float64(obstacle[2]), row)[0]
        return max(d - np.float64(obstacle[5]), 0.0)
    gap = math.inf
    for k in range(4):
        x, y = _corner(row, 0, k)
        gap = min(gap, nearest(x, y, obstacle)[0])
        for bar in range(int(obstacle[0])):  # shape codes count bars
            x, y = _corner(obstacle, bar, k)
            gap = min(gap, nearest(x, y, row)[0])
    return gap


@kernel
def payload_wall_gap(row: Float, half: Double, wall: int) -> float:
    """Gap (m) between a payload's row [8] and a wall; negative if the payload is in the wall.

    `wall`: its number, as in `geometry.wall_gap`.
    """
    if row[0] == CIRCLE:
        return wall_gap(np.float64(row[1]), np.float64(row[2]), half, wall) - np.float64(row[5])
    gap = math.inf
    for k in range(4):
        x, y = _corner(row, 0, k)
        gap = min(gap, wall_gap(x, y, half, wall))
    return gap


@kernel
def count_contacts(bodies: Float, shape: Shape, layout: Float, half: Double) -> int:
    """Counts the contacts with obstacles and walls that begin in a payload's states [T + 1, 7].

    A contact begins at a gap of at most `CONTACT_GAP` and ends beyond twice that. `layout`:
    obstacles, [M, 8].
    """
    n_obstacles = layout.shape[0]
    touching = np.zeros(n_obstacles + 4, dtype=np.bool_)
    row = np.empty(8, dtype=np.float32)
    count = 0
    for t in range(bodies.shape[0]):
        place_row(bodies[t], shape, row)
        for m in range(n_obstacles + 4):
            if m < n_obstacles:
                dx, dy = layout[m, 1] - row[1], layout[m, 2] - row[2]
                reach = bounding_radius(layout[m]) + bounding_radius(row) + 2.0 * CONTACT_GAP
                far = dx * dx + dy * dy > reach * reach
                gap = math.inf if far else obstacle_gap(row, layout[m])
            else:
                gap = payload_wall_gap(row, half, m - n_obstacles)
            if not touching[m] and gap <= CONTACT_GAP:
                touching[m] = True
                count += 1
            elif gap > 2.0 * CONTACT_GAP:
                touching[m] = False
    return count


@kernel
def count_pushes(positions: Float, radii: Double, bodies: Float, shape: Shape) -> int:
    """Counts the robots in contact with the payload, summed over all states.

    `positions`: of the robots, m, [T, N, 2]. `bodies`: the payload, [T, 7].
    """
    row = np.empty(8, dtype=np.float32)
    count = 0
    for t in range(bodies.shape[0]):
        place_row(bodies[t], shape, row)
        for i in range(radii.shape[0]):
            d = nearest(np.float64(positions[t, i, 0]), np.float64(positions[t, i, 1]), row)[0]
            count += d - radii[i] <= CONTACT_GAP
    return count
