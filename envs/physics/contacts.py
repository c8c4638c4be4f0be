"""Contact events from positions, as Munk2D has them: from overlap after a step to separation."""

import math

from swarmdata.envs.physics.free_motion import EXACT_GAP_LIMIT
from swarmdata.numerics.geometry import nearest, outer_radius, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.types import SEPARATION_GAP, Bool, Counts, Double, Float


@kernel(inline="always")
def _judge(gap: float, touching: bool) -> tuple[bool, bool]:
    """Returns whether there is a contact now, and whether it has just begun."""
    if touching:
        return gap <= SEPARATION_GAP, False
    return gap <= 0.0, gap <= 0.0


@kernel(inline="always")
def _robot_contacts(positions: Double, radii: Double, robots: Bool, events: Counts) -> None:
    for i in range(positions.shape[0]):
        for j in range(i + 1, positions.shape[0]):
            dx, dy = positions[j, 0] - positions[i, 0], positions[j, 1] - positions[i, 1]
            reach = radii[i] + radii[j] + 2.0 * SEPARATION_GAP
            square = dx * dx + dy * dy
            if square > reach * reach and not robots[i, j]:
                continue
            gap = math.sqrt(square) - radii[i] - radii[j]
            robots[i, j], began = _judge(gap, robots[i, j])
            if gap <= 0.0:
                events[i, 0] = 1
                events[j, 0] = 1
            if began:
                events[i, 2] += 1
                events[j, 2] += 1


@kernel
def _static_contacts(
    px: float, py: float, radius: float, layout: Float, half: Double, touching: Bool, events: Counts
) -> float:
    """Updates one robot's contacts with obstacles and walls; returns a lower bound of its gap."""
    smallest = math.inf
    n_obstacles = layout.shape[0]
    for m in range(n_obstacles + 4):
        if m < n_obstacles:
            dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
            reach = outer_radius(layout[m]) + radius + EXACT_GAP_LIMIT
            square = dx * dx + dy * dy
            gap = (
                EXACT_GAP_LIMIT
                if square > reach * reach
                else nearest(px, py, layout[m])[0] - radius
            )
        else:
            gap = wall_gap(px, py, half, m - n_obstacles) - radius
        smallest = min(smallest, gap)
        touching[m], began = _judge(gap, touching[m])
        if gap <= 0.0:
            events[1] = 1
        if began:
            events[3] += 1
    return smallest


@kernel
def update_contacts(
    positions: Double,  # [N, any] the first two columns, m
    radii: Double,  # [N] m
    layout: Float,  # [M, 8] obstacles
    half: Double,  # [2] half width and half height of the arena, m
    robots: Bool,  # [N, N] upper triangle, read and written
    obstacles: Bool,  # [N, M + 4] read and written
    slack: Double,  # [N, 3] read and written, as in `backend.Contacts`
    events: Counts,  # [N, 4] columns `types.EVENTS`, added to
) -> None:
    """Updates the contacts of one copy, of its pairs of robots and with obstacles and walls.

    A robot that has moved less than its slack cannot touch anything static. Onsets count for both
    robots of a pair.
    """
    _robot_contacts(positions, radii, robots, events)
    for i in range(positions.shape[0]):
        px, py = positions[i, 0], positions[i, 1]
        moved = abs(px - slack[i, 0]) + abs(py - slack[i, 1])
        if moved < slack[i, 2] - 2.0 * SEPARATION_GAP:
            for m in range(obstacles.shape[1]):
                obstacles[i, m] = False
            continue
        slack[i, 2] = _static_contacts(px, py, radii[i], layout, half, obstacles[i], events[i])
        slack[i, 0] = px
        slack[i, 1] = py
