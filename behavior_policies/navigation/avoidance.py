"""Velocity limits of one robot: half-planes for the surfaces and for the robots near it.

Functions write rows of `planes` (`orca`), from row n on if they are given n, and return how many
rows are written. Times and distances are those of the reference robot, scaled for others by
`scales`, [N, 2] (`robot_scales`).
"""

import math

from swarmdata.behavior_policies.navigation.orca import damper_half_plane, robot_half_plane
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, Team
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.numerics.geometry import nearest, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float

AVOIDANCE_HORIZON = 1.0
"""Seconds for which robots avoid each other. Above 2 v / a = 0.8 s, so that they can brake; longer
horizons make crowds stall."""

BRAKING_TIME = 0.6
"""Seconds in which a gap may be closed: approach speed <= gap / BRAKING_TIME. Braking alone needs
v / a = 0.4 s; the rest is for turning at the same time, which shares the acceleration limit."""

SURFACE_REACH = 0.4  # m from a surface within which it can limit the speed: v BRAKING_TIME and more
ROBOT_GAP = 0.03  # m of gap kept between robots
SURFACE_GAP = 0.01  # m kept from surfaces; below the planner's `PATH_GAP`
SENSING_DISTANCE = 1.5  # m between centres of robots that see each other: 2 v horizon, two radii
GIVE_WAY_DISTANCE = 0.5  # m from its goal within which a robot gives way


@kernel
def surface_half_planes(
    x: float,  # m
    y: float,  # m
    radius: float,  # of the robot, m
    primitives: Float,  # [P, 8] convex obstacles
    half: Double,  # [2] half width and half height of the arena, m
    planes: Double,  # [P + 4, 4] or more, written from row 0
    time: float = 1.0,  # the robot's time scale (`robot_scales`)
    length: float = 1.0,  # its length scale
) -> int:
    """Writes the velocities with which a robot at (x, y) can still brake before surfaces."""
    n = 0
    reach, brake = radius + SURFACE_REACH * length, BRAKING_TIME * time
    for m in range(primitives.shape[0]):
        dx, dy = float(primitives[m, 1]) - x, float(primitives[m, 2]) - y
        size = reach + primitives[m, 5] + primitives[m, 6]
        if dx * dx + dy * dy > size * size:
            continue
        d, vx, vy = nearest(x, y, primitives[m])
        if 0.0 < d < reach:
            damper_half_plane(vx / d, vy / d, (d - radius - SURFACE_GAP) / brake, planes[n])
            n += 1
    for wall in range(4):
        gap = wall_gap(x, y, half, wall)
        if gap < reach:
            sign = 1.0 if wall % 2 == 0 else -1.0
            nx, ny = (sign, 0.0) if wall < 2 else (0.0, sign)
            damper_half_plane(nx, ny, (gap - radius - SURFACE_GAP) / brake, planes[n])
            n += 1
    return n


@kernel
def stopping_half_planes(i: int, robots: Double, team: Team, n: int, planes: Double) -> int:
    """Writes the velocities with which a unicycle can still stop before every robot near it.

    It cannot leave sideways, so the correction that `robot_half_planes` asks for may not come in
    time. Each of a pair may close half of their gap in the time that the slower one needs to stop.
    Decentralised barrier certificates (Wang, Ames and Egerstedt, IEEE Transactions on Robotics 33,
    2017) with a linear barrier have this form.
    """
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        d = max(math.sqrt(x * x + y * y), 1e-9)
        gap = max(d - team.radii[i] - team.radii[j] - SURFACE_GAP, 0.0)
        bound = 0.5 * gap / max(team.stopping_times[i], team.stopping_times[j])
        if j == i or bound >= team.limits[i, SPEED]:
            continue
        damper_half_plane(x / d, y / d, bound, planes[n])
        n += 1
    return n


@kernel(inline="always")
def pair_scales(i: int, j: int, scales: Double) -> tuple[float, float]:
    """Time and length scale of a pair: the larger of each, so that both robots use the same."""
    time = max(scales[i, TIME_SCALE], scales[j, TIME_SCALE])
    return time, max(scales[i, LENGTH_SCALE], scales[j, LENGTH_SCALE])


@kernel
def brake_half_planes(
    i: int, robots: Double, radii: Double, scales: Double, n: int, planes: Double
) -> int:
    """Writes the velocities with which robot i can still brake before every robot near it.

    One that drives away allows a higher speed. Zero velocity is always among them. `robots`: x, y,
    vx, vy first, [N, C]. `radii`: m, [N].
    """
    for j in range(robots.shape[0]):
        time, length = pair_scales(i, j, scales)
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        sensing_distance = SENSING_DISTANCE * length
        if j == i or x * x + y * y > sensing_distance * sensing_distance:
            continue
        d = max(math.sqrt(x * x + y * y), 1e-9)
        leaving = max((robots[j, 2] * x + robots[j, 3] * y) / d, 0.0)
        room = max(d - radii[i] - radii[j] - SURFACE_GAP, 0.0) / (BRAKING_TIME * time)
        damper_half_plane(x / d, y / d, room + leaving, planes[n])
        n += 1
    return n


@kernel
def robot_half_planes(
    i: int,
    robots: Double,  # [N, C] columns x, y, vx, vy first
    radii: Double,  # [N] m
    scales: Double,  # [N, 2] of time and length (`robot_scales`)
    aims: Double,  # [N, 3] preferred velocity, m/s; distance to the goal, m, decides who gives way
    rule: tuple[float, float],  # horizon of avoidance, s; gap kept, m
    n: int,  # half-planes written so far
    planes: Double,  # written from row n
) -> int:
    """Writes the velocities of robot i that are safe with the robots near it."""
    velocity, (horizon, gap) = (robots[i, 2], robots[i, 3]), rule
    for j in range(robots.shape[0]):
        time, length = pair_scales(i, j, scales)
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        sensing_distance = SENSING_DISTANCE * length
        if j == i or x * x + y * y > sensing_distance * sensing_distance:
            continue
        reach, other = radii[i] + radii[j] + gap, (robots[j, 2], robots[j, 3])
        half = (horizon * time, BRAKING_TIME * time, 0.5)
        robot_half_plane((x, y), velocity, other, reach, half, planes[n])
        n += 1
        if gives_way(aims[i, 2], aims[j, 2], GIVE_WAY_DISTANCE * length):
            aim, whole = (aims[j, 0], aims[j, 1]), (horizon * time, BRAKING_TIME * time, 1.0)
            robot_half_plane((x, y), velocity, aim, reach, whole, planes[n])
            n += 1
    return n


@kernel
def gives_way(distance: float, other: float, near: float = GIVE_WAY_DISTANCE) -> bool:
    """Whether a robot at this distance from its goal gives way to one at the other distance, m."""
    return distance < near and other > distance
