"""Free motion: a physics step in which nothing can touch needs no solver.

A physics step is free if every gap, between robots and to obstacles and walls, is above
`SEPARATION_GAP` once the robots have moved by their velocities. `move` does the operations of
Munk2D's own integration, in its order. Free motion ends every contact, and the next other step
starts with a new solver, so a world does not depend on what the solver did before. Worlds with
movable bodies have no free motion: the floor's friction acts in every step.
"""

import math

from swarmdata.envs.physics.dynamics import ACCELERATION, GRIP, SPEED, UNICYCLE
from swarmdata.numerics.geometry import nearest_of, outer_radius, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.types import SEPARATION_GAP, Double, Float

EXACT_GAP_LIMIT = 0.5  # gaps to obstacles and walls beyond this (m) need not be exact
_ROUNDING = 1e-9  # more (m) than rounding errors of distances; it makes a bound of travel safe


@kernel(inline="always")
def move(robots: Double, accelerations: Double, dt: float) -> None:
    """Moves robots [N, 6] for one free physics step of `dt` s: positions first, then velocities.

    `accelerations`: m/s^2, [N, 2].
    """
    for i in range(robots.shape[0]):
        robots[i, 0] += robots[i, 2] * dt
        robots[i, 1] += robots[i, 3] * dt
        # Munk2D adds the acceleration to gravity, which turns -0.0 into 0.0.
        robots[i, 2] += (0.0 + accelerations[i, 0]) * dt
        robots[i, 3] += (0.0 + accelerations[i, 1]) * dt


@kernel(inline="always")
def write_travel_bounds(robots: Double, limits: Double, time: float, out: Double) -> None:
    """Writes upper bounds of the distances that robots [N, 6] travel in free motion, m, [N].

    `limits`: [N, 9]. `time`: s.
    """
    for i in range(robots.shape[0]):
        speed = math.sqrt(robots[i, 2] * robots[i, 2] + robots[i, 3] * robots[i, 3])
        if limits[i, UNICYCLE] == 1.0:
            fastest = speed + (limits[i, ACCELERATION] + limits[i, GRIP]) * time
        else:
            fastest = max(speed, limits[i, SPEED])
        out[i] = fastest * time + _ROUNDING


@kernel
def static_gap(px: float, py: float, radius: float, layout: Float, half: Double) -> float:
    """Returns a robot's gap to the nearest obstacle or wall, or `EXACT_GAP_LIMIT` if larger."""
    gap = EXACT_GAP_LIMIT
    for wall in range(4):
        gap = min(gap, wall_gap(px, py, half, wall) - radius)
    for m in range(layout.shape[0]):
        dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
        reach = outer_radius(layout[m]) + radius + gap
        if reach > 0.0 and dx * dx + dy * dy < reach * reach:
            gap = min(gap, nearest_of(px, py, layout, m)[0] - radius)
    return gap


@kernel(inline="always")
def is_free(
    robots: Double,  # [N, 6]
    ahead: float,  # s; gaps are those after robots have moved by their velocities for this time
    travel: Double,  # [N] how much further they may move, m
    radii: Double,  # [N] m
    layout: Float,  # [M, 8] obstacles
    half: Double,  # [2] half width and half height of the arena, m
    slack: Double,  # [N, 3] read and written, `backend.Contacts.slack` of this copy
) -> bool:
    """Whether every gap stays above `SEPARATION_GAP`."""
    n = robots.shape[0]
    for i in range(n):
        px, py = robots[i, 0] + robots[i, 2] * ahead, robots[i, 1] + robots[i, 3] * ahead
        reserve = radii[i] + travel[i] + SEPARATION_GAP
        for j in range(i + 1, n):
            dx = robots[j, 0] + robots[j, 2] * ahead - px
            dy = robots[j, 1] + robots[j, 3] * ahead - py
            reach = reserve + radii[j] + travel[j]
            if dx * dx + dy * dy <= reach * reach:
                return False
    for i in range(n):
        px, py = robots[i, 0] + robots[i, 2] * ahead, robots[i, 1] + robots[i, 3] * ahead
        needed = travel[i] + SEPARATION_GAP
        moved = abs(px - slack[i, 0]) + abs(py - slack[i, 1])
        if slack[i, 2] - moved > needed:
            continue
        slack[i, 0], slack[i, 1] = px, py
        slack[i, 2] = static_gap(px, py, radii[i], layout, half)
        if slack[i, 2] <= needed:
            return False
    return True
