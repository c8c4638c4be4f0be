"""Constants of a team's robots for navigation, among them their time and length scales.

Distances and times of `avoidance` and `navigator` suit the reference robot (radius 0.12 m, 0.6 m/s,
1.5 m/s^2). Another's are multiplied by its time scale, the largest ratio to the reference of: its
braking time v / a; its time to cross its own radius r / v; and, of a unicycle, half its time for a
right-angle turn (to the braking time); or by its length scale, the ratio of the distances driven at
full speed in these times.
"""

from typing import NamedTuple, Self

import numpy as np

from swarmdata.envs.physics.dynamics import ACCELERATION, SPEED, limits_of
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double

REFERENCE_ROBOT = Robot()

RIGHT_ANGLE = 1.5707963267948966

TIME_SCALE, LENGTH_SCALE = range(2)  # columns of the scales


class Team(NamedTuple):
    """Constants of a team's robots, for kernels."""

    radii: Double  # [N] m
    limits: Double  # [N, 9] `dynamics.limits_of`
    scales: Double  # [N, 2] of time and length
    stopping_times: Double  # [N] s, from full speed; a command takes effect one step late
    control_dt: float  # s

    @classmethod
    def of(cls, spec: TaskSpec) -> Self:
        limits, control_dt = limits_of(spec), spec.control_dt
        stopping_times = limits[:, SPEED] / limits[:, ACCELERATION] + control_dt
        radii = np.array([robot.radius for robot in spec.robots])
        return cls(radii, limits, scales_of(spec), stopping_times, control_dt)


def scales_of(spec: TaskSpec) -> Double:
    """Time and length scale of every robot, [N, 2]."""
    reference = REFERENCE_ROBOT
    braking_time = reference.max_speed / reference.max_acceleration
    rows = []
    for robot in spec.robots:
        braking = (robot.max_speed / robot.acceleration) / braking_time
        crossing = (robot.radius / robot.max_speed) / (reference.radius / reference.max_speed)
        time = max(braking, crossing)
        if robot.dynamics == "unicycle":
            time = max(time, RIGHT_ANGLE / robot.max_turn_rate / (2.0 * braking_time))
        rows.append((time, time * (robot.max_speed / reference.max_speed)))
    return np.array(rows)
