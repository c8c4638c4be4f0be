"""Contact events from positions: a contact begins at overlap and ends at separation.

Overlap of positions after a physics step is exactly what Munk2D reports as a contact, and is 100
times cheaper to find here than through its callbacks.
"""

import math

from numba import njit

from swarmdata.geometry import bounding_radius, nearest, wall_gap
from swarmdata.types import Bool, Counts, Double, Float

SEPARATION = 0.01
"""A contact ends when the gap exceeds this (m); a resting contact jitters by less."""


@njit(nogil=True, cache=True, inline="always")
def _judge(gap: float, touching: bool) -> tuple[bool, bool]:
    """Returns (touching now, whether the contact began)."""
    if touching:
        return gap <= SEPARATION, False
    return gap <= 0.0, gap <= 0.0


@njit(nogil=True, cache=True)
def update_contacts(
    positions: Double,
    radii: Double,
    layout: Float,
    half: Double,
    robots: Bool,
    obstacles: Bool,
    events: Counts,
) -> None:
    """Updates the contacts of one copy and adds to its events.

    Args:
        positions: [N, 2] m.
        radii: [N] m.
        layout: obstacles, [M, 8].
        half: half width and half height of the arena, m, [2].
        robots: read and written, [N, N] upper triangle.
        obstacles: read and written, [N, M + 4].
        events: added to, [N, 4] columns `types.EVENTS`; onsets count for both robots of a pair.
    """
    n, m_obstacles = positions.shape[0], layout.shape[0]
    for i in range(n):
        px, py = positions[i, 0], positions[i, 1]
        for j in range(i + 1, n):
            dx, dy = positions[j, 0] - px, positions[j, 1] - py
            gap = math.sqrt(dx * dx + dy * dy) - radii[i] - radii[j]
            robots[i, j], began = _judge(gap, robots[i, j])
            if gap <= 0.0:
                events[i, 0] = 1
                events[j, 0] = 1
            if began:
                events[i, 2] += 1
                events[j, 2] += 1
        for m in range(m_obstacles + 4):
            gap = _static_gap(px, py, radii[i], layout, half, m)
            obstacles[i, m], began = _judge(gap, obstacles[i, m])
            if gap <= 0.0:
                events[i, 1] = 1
            if began:
                events[i, 3] += 1


@njit(nogil=True, cache=True, inline="always")
def _static_gap(px: float, py: float, radius: float, layout: Float, half: Double, m: int) -> float:
    """Gap to obstacle m, or to wall m - M; far obstacles give a lower bound above SEPARATION."""
    if m >= layout.shape[0]:
        return wall_gap(px, py, half, m - layout.shape[0]) - radius
    dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
    reach = bounding_radius(layout[m]) + radius + 2.0 * SEPARATION
    if dx * dx + dy * dy > reach * reach:
        return 2.0 * SEPARATION
    return nearest(px, py, layout[m])[0] - radius
