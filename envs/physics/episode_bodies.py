"""The robots of each episode: those of the spec, with what the episode has drawn instead."""

import numpy as np

from swarmdata.envs.physics.dynamics import (
    ACCELERATION,
    FRICTION,
    GRIP,
    MASS,
    SPEED,
    TURN_RATE,
    UNICYCLE,
    limits_of,
)
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Seeds

COLUMNS = {
    "max_speed": SPEED,
    "max_turn_rate": TURN_RATE,
    "mass": MASS,
    "friction": FRICTION,
    "wheel_grip": GRIP,
}
"""Columns of the limits that are fields of robots; accelerations follow from three of them."""


def episode_limits(spec: TaskSpec, seeds: Seeds) -> Double:
    """Returns limits and bodies of the robots of some episodes, [E, N, 8].

    Args:
        spec: of the episodes.
        seeds: of the episodes, [E].
    """
    limits = np.tile(limits_of(spec), (len(seeds), 1, 1))
    drawn = drawn_values(spec, seeds)
    for name in COLUMNS.keys() & drawn.keys():
        limits[..., COLUMNS[name]] = drawn[name]
    nominal = np.array([robot.max_acceleration for robot in spec.robots])
    driven = drawn.get("max_acceleration", nominal) / limits[..., MASS]
    gripped = np.minimum(driven, limits[..., GRIP])
    limits[..., ACCELERATION] = np.where(limits[..., UNICYCLE] == 1.0, gripped, driven)
    return limits
