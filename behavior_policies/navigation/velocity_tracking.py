"""Velocity tracking: the command of a robot's drive for a wanted velocity.

A unicycle turns towards it, and drives along its heading at the velocity's component along it,
within the half-planes of safe velocities: safety does not depend on the heading.
"""

import math

from swarmdata.behavior_policies.navigation.orca import PARALLEL_TOLERANCE
from swarmdata.envs.physics.dynamics import (
    ACCELERATION,
    BY_VELOCITY,
    DIFFERENTIAL,
    SPEED,
    TURN_RATE,
    UNICYCLE,
)
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double

REVERSE_MAX_SPEED_SHARE = 0.5  # of the speed, below which a unicycle backs up
TURN_MIN_SPEED_SHARE = 0.002  # share of the maximum speed below which a unicycle does not turn


@kernel
def command_of(
    velocity: tuple[float, float],  # of the robot, m/s
    heading: tuple[float, float],  # unit vector
    wish: tuple[float, float],  # wanted velocity, at most the robot's maximum speed, m/s
    limit: Double,  # [9] row of `dynamics.limits_of`
    planes: Double,  # [K, 4] of safe velocities (`orca`), most important ones first
    n_planes: int,  # number of half-planes
    dt: float,  # control step, s
    out: Double,  # [2] written, in [-1, 1]
) -> None:
    """Writes the command of one robot."""
    if limit[UNICYCLE] == 1.0:
        out[1], top = turn_command(heading, wish, limit, dt), limit[SPEED]
        if limit[DIFFERENTIAL] == 1.0:  # wheels share their speed between driving and turning
            ahead = abs(heading[0] * wish[0] + heading[1] * wish[1]) / limit[SPEED]
            out[1] /= max(ahead + abs(out[1]), 1.0)
            top *= 1.0 - abs(out[1])
        half = 0.5 * limit[TURN_RATE] * out[1] * dt  # tangent of half the angle, nearly
        scale = 1.0 / (1.0 + half * half)
        cos, sin = (1.0 - half * half) * scale, 2.0 * half * scale
        ux, uy = heading[0] * cos - heading[1] * sin, heading[0] * sin + heading[1] * cos
        speed = speed_along((ux, uy), wish, top, planes, n_planes)
        if limit[BY_VELOCITY] == 0.0:
            ahead = velocity[0] * heading[0] + velocity[1] * heading[1]
            out[0] = min(max((speed - ahead) / (dt * limit[ACCELERATION]), -1.0), 1.0)
        else:
            out[0] = speed / limit[SPEED]
    elif limit[BY_VELOCITY] == 1.0:
        out[0], out[1] = wish[0] / limit[SPEED], wish[1] / limit[SPEED]
    else:
        reach = dt * limit[ACCELERATION]
        ax, ay = (wish[0] - velocity[0]) / reach, (wish[1] - velocity[1]) / reach
        norm = max(math.sqrt(ax * ax + ay * ay), 1.0)
        out[0], out[1] = ax / norm, ay / norm


@kernel
def turn_command(
    heading: tuple[float, float], wish: tuple[float, float], limit: Double, dt: float
) -> float:
    """Turn rate towards a velocity, or away from it to back up, as a share of the limit, [-1, 1].

    The angle left to turn is twice the arctangent of side / (speed + ahead), nearly twice that.
    """
    ahead = heading[0] * wish[0] + heading[1] * wish[1]
    side = heading[0] * wish[1] - heading[1] * wish[0]
    speed = math.sqrt(wish[0] * wish[0] + wish[1] * wish[1])
    if speed < TURN_MIN_SPEED_SHARE * limit[SPEED]:
        return 0.0
    if ahead < 0.0 and speed < REVERSE_MAX_SPEED_SHARE * limit[SPEED]:
        ahead, side = -ahead, -side
    tangent = side / max(speed + ahead, 1e-9 * speed)
    return float(min(max(2.0 * tangent / (dt * limit[TURN_RATE]), -1.0), 1.0))


@kernel
def speed_along(
    heading: tuple[float, float],  # unit vector
    wish: tuple[float, float],  # m/s
    top: float,  # largest speed, m/s
    planes: Double,  # [K, 4] as in `command_of`
    n_planes: int,
) -> float:
    """The safe speed along a heading that is nearest to a velocity's component along it, m/s.

    If none is safe, the one nearest to zero within the half-planes before the first impossible one.
    """
    low, high = -top, top
    wanted = heading[0] * wish[0] + heading[1] * wish[1]
    for k in range(n_planes):
        new_low, new_high = _narrowed(planes[k], heading, low, high)
        if new_low > new_high:
            return min(max(0.0, low), high)
        low, high = new_low, new_high
    return min(max(wanted, low), high)


@kernel
def _narrowed(
    plane: Double, heading: tuple[float, float], low: float, high: float
) -> tuple[float, float]:
    """The part of an interval of speeds along a heading that is inside a half-plane."""
    px, py, dx, dy = plane[0], plane[1], plane[2], plane[3]
    slope, bound = dx * heading[1] - dy * heading[0], dx * py - dy * px
    if slope > PARALLEL_TOLERANCE:
        return max(low, bound / slope), high
    if slope < -PARALLEL_TOLERANCE:
        return low, min(high, bound / slope)
    return low, high
