"""Array bundles of the pushing kernels: the payload's state, and constants of payload and team."""

from typing import NamedTuple, Self

import numpy as np

from swarmdata.envs.transport.payload import Shape, payload_radius, shape_of
from swarmdata.numerics.exact_math import sum_in_order
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double

SIDE_ROOM = 0.15  # m beside the payload that its path keeps free where it can, for robots


class PayloadState(NamedTuple):
    """A payload in one state."""

    body: Double  # [7] columns `state_layout.BODY`
    shape: Shape


class PushSetup(NamedTuple):
    """Constants of a payload and of the team that pushes it."""

    radii: Double  # [N] m, of the robots
    max_speeds: Double  # [N] m/s
    insets: Double  # [N] m by which each radius is smaller than the largest
    max_radius: float  # m
    control_dt: float  # s
    shape: Shape  # of the payload
    moved_mass: float  # kg, of the payload and the robots
    friction: float  # N
    robot_force: float  # N, largest force of a robot: that which accelerates 1 kg
    held_torque: float  # N m, largest torque that friction holds
    n_needed: float  # robots whose forces together move the payload
    path_radius: float  # m, of the circle that the payload's path is planned for

    @classmethod
    def of(cls, spec: TaskSpec, payload: Payload) -> Self:
        radii = np.array([robot.radius for robot in spec.robots])
        robot_force = min(robot.max_acceleration for robot in spec.robots)
        reach = payload_radius(payload)
        return cls(
            radii=radii,
            max_speeds=np.array([robot.max_speed for robot in spec.robots]),
            insets=radii.max() - radii,
            max_radius=float(radii.max()),
            control_dt=spec.control_dt,
            shape=shape_of(payload),
            moved_mass=float(payload.mass + sum_in_order(robot.mass for robot in spec.robots)),
            friction=float(payload.friction),
            robot_force=float(robot_force),
            held_torque=payload.friction * reach / 2.0,
            n_needed=1.05 * payload.friction / robot_force,
            path_radius=reach + SIDE_ROOM,
        )
