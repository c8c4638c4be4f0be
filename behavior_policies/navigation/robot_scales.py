"""How much slower and larger than the reference robot a robot is: the scales of avoidance.

The distances and times of `avoidance` and `scripted` suit the reference robot (radius 0.12 m, 0.6
m/s, 1.5 m/s^2). For another robot they are multiplied by two factors, both 1 for the reference:

    time    the largest of: how much longer it needs to brake, v / a; how much longer to cross its
            own radius, r / v; and, for a unicycle, how much longer to turn by a right angle than
            the reference needs to brake twice
    length  the distance that it drives at full speed in that time

Float64 `+ - * /` only, so that the bits are the same on every platform.
"""

import numpy as np

from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double

REFERENCE = Robot()

RIGHT_ANGLE = 1.5707963267948966

TIME, LENGTH = range(2)
"""Columns of the scales."""


def scales_of(spec: TaskSpec) -> Double:
    """Time and length scale of every robot, [N, 2]."""
    return np.array([_scales(robot) for robot in spec.robots])


def _scales(robot: Robot) -> tuple[float, float]:
    braking = (robot.max_speed / robot.max_acceleration) / _BRAKING
    crossing = (robot.radius / robot.max_speed) / (REFERENCE.radius / REFERENCE.max_speed)
    time = max(braking, crossing)
    if robot.dynamics == "unicycle":
        time = max(time, RIGHT_ANGLE / robot.max_turn_rate / (2.0 * _BRAKING))
    return time, time * (robot.max_speed / REFERENCE.max_speed)


_BRAKING = REFERENCE.max_speed / REFERENCE.max_acceleration
