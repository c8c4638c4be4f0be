"""What limits one robot's velocity: the surfaces near it, and the robots near it.

Times and distances are those of the reference robot; `agility` scales them for others.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

from swarmdata.behavior_policies.navigation.orca import damper_half_plane, robot_half_plane
from swarmdata.numerics.geometry import nearest, wall_gap
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float

HORIZON = 1.0
"""Seconds for which robots avoid each other. Above 2 v / a = 0.8 s, so that they can brake; longer
horizons make crowds stall."""

BRAKE = 0.6
"""Seconds in which a gap may be closed: approach speed <= gap / BRAKE. Braking alone needs v / a =
0.4 s; the rest is for turning at the same time, which shares the acceleration limit."""

REACH = 0.4
"""Metres from a surface within which it can limit the speed: v BRAKE, and a margin."""

ROBOT_MARGIN = 0.03
"""Metres of gap kept between robots."""

SURFACE_MARGIN = 0.01
"""Metres of gap kept from surfaces; below the planner's `MARGIN`, so that ways can be driven."""

SENSE = 1.5
"""Metres between centres beyond which robots ignore each other: 2 v HORIZON and two radii."""

NEAR = 0.5
"""Metres from its goal within which a robot gives way."""


@kernel
def surface_half_planes(
    x: float,
    y: float,
    radius: float,
    primitives: Float,
    half: Double,
    planes: Double,
    time: float = 1.0,
    length: float = 1.0,
) -> int:
    """Writes the velocities with which a robot can still brake before every surface near it.

    Args:
        x: position, m.
        y: position, m.
        radius: of the robot, m.
        primitives: convex obstacles, [P, 8].
        half: half width and half height of the arena, m, [2].
        planes: written from row 0, at least [P + 4, 4].
        time: the robot's time scale (`agility`).
        length: its length scale.

    Returns:
        How many half-planes were written.
    """
    n = 0
    reach, brake = radius + REACH * length, BRAKE * time
    for m in range(primitives.shape[0]):
        dx, dy = float(primitives[m, 1]) - x, float(primitives[m, 2]) - y
        size = reach + primitives[m, 5] + primitives[m, 6]
        if dx * dx + dy * dy > size * size:
            continue
        d, vx, vy = nearest(x, y, primitives[m])
        if 0.0 < d < reach:
            damper_half_plane(vx / d, vy / d, (d - radius - SURFACE_MARGIN) / brake, planes[n])
            n += 1
    for wall in range(4):
        gap = wall_gap(x, y, half, wall)
        if gap < reach:
            sign = 1.0 if wall % 2 == 0 else -1.0
            nx, ny = (sign, 0.0) if wall < 2 else (0.0, sign)
            damper_half_plane(nx, ny, (gap - radius - SURFACE_MARGIN) / brake, planes[n])
            n += 1
    return n


@kernel
def stopping_half_planes(
    i: int, robots: Double, bodies: Double, brakes: Double, n: int, planes: Double
) -> int:
    """Writes the velocities with which a unicycle can still stop before every robot near it.

    A unicycle cannot leave sideways, so the correction that `robot_half_planes` asks for may not
    come in time. Each of a pair may close half of their gap in the time that the slower one needs
    to stop, so that they never touch if both keep to it; standing still always does. Decentralised
    barrier certificates (Wang, Ames and Egerstedt, IEEE Transactions on Robotics 33, 2017) with a
    linear barrier have this form.

    Args:
        i: which robot.
        robots: columns of the state, at least x and y, [N, C].
        bodies: radius, m, and maximum speed, m/s, [N, at least 2].
        brakes: time to stop from full speed, s, [N].
        n: how many half-planes there are already.
        planes: written from row n.

    Returns:
        How many half-planes there are now.
    """
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        d = max(math.sqrt(x * x + y * y), 1e-9)
        gap = max(d - bodies[i, 0] - bodies[j, 0] - SURFACE_MARGIN, 0.0)
        bound = 0.5 * gap / max(brakes[i], brakes[j])
        if j == i or bound >= bodies[i, 1]:
            continue
        damper_half_plane(x / d, y / d, bound, planes[n])
        n += 1
    return n


@kernel
def robot_half_planes(
    i: int,
    robots: Double,
    radii: Double,
    aims: Double,
    n: int,
    planes: Double,
    scales: Double | None = None,
) -> int:
    """Writes the velocities of robot i that are safe with the robots near it.

    Args:
        i: which robot.
        robots: columns of the state, [N, 6].
        radii: m, [N].
        aims: preferred velocity, m/s, and distance to the goal, m, of every robot, [N, 3].
        n: how many half-planes there are already.
        planes: written from row n.
        scales: of time and length of every robot (`agility`), [N, 2]; a pair takes the larger
            ones, so that both see each other alike. None: all are reference robots.

    Returns:
        How many half-planes there are now.
    """
    own = (robots[i, 2], robots[i, 3])
    for j in range(robots.shape[0]):
        time, length = 1.0, 1.0
        if scales is not None:
            time, length = max(scales[i, 0], scales[j, 0]), max(scales[i, 1], scales[j, 1])
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        sense = SENSE * length
        if j == i or x * x + y * y > sense * sense:
            continue
        reach = radii[i] + radii[j] + ROBOT_MARGIN
        velocity = (robots[j, 2], robots[j, 3])
        rule = (HORIZON * time, BRAKE * time, 0.5)
        robot_half_plane((x, y), own, velocity, reach, rule, planes[n])
        n += 1
        if gives_way(aims[i, 2], aims[j, 2], NEAR * length):
            wish = (aims[j, 0], aims[j, 1])
            rule = (HORIZON * time, BRAKE * time, 1.0)
            robot_half_plane((x, y), own, wish, reach, rule, planes[n])
            n += 1
    return n


@kernel
def gives_way(own: float, other: float, near: float = NEAR) -> bool:
    """Whether a robot this far from its goal gives way to one that far from its own, m."""
    return own < near and other > own
