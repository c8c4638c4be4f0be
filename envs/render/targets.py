"""The targets of a state as data: their places, as `Appearance` says, and which are met."""

from typing import NamedTuple

import numpy as np

from swarmdata.registry.appearance import Appearance
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import TX, TY, X, Y
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double


class Target(NamedTuple):
    """Where a robot should be, or any robot if it is of none."""

    x: float  # m
    y: float  # m
    radius: float  # m, within which it is reached
    robot: int | None
    is_reached: bool


def targets_of(look: Appearance, spec: TaskSpec, robots: Double, extras: Double) -> list[Target]:
    """The targets that are drawn in a state: its robots, [N, 8], and the task's own part of it."""
    places = robots[:, [X, Y]]
    if look.shared is not None:
        shared = extras[: 2 * look.shared.n].reshape(-1, 2)
        radius = look.radius or max(robot.radius for robot in spec.robots)
        gaps = np.hypot(*np.moveaxis(shared[:, None] - places, -1, 0)).min(axis=1)  # [n]
        reached = gaps <= radius
        if look.shared.reached is not None:
            reached = extras[look.shared.reached :][: look.shared.n] > 0
        return [
            Target(x, y, radius, None, is_reached)
            for (x, y), is_reached in zip(shared.tolist(), reached.tolist(), strict=True)
        ]
    found = []
    for i, (x, y) in enumerate(robots[:, [TX, TY]].tolist()):
        radius = spec.robots[i].radius if look.radius is None else look.radius
        gap = float(np.hypot(places[i, 0] - x, places[i, 1] - y))
        found.append(Target(x, y, radius, i, gap <= radius))
    return found


def payload_outline(payload: Payload, place: Double, towards: Double) -> Double:
    """Returns the corners of a payload whose local x axis is the unit vector `towards`, [K, 2]."""
    side = np.array([-towards[1], towards[0]])
    if payload.shape == "circle":
        angles = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
        local = payload.half_length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        half = np.array([payload.half_length, payload.half_width])
        local = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return place + local[:, :1] * towards + local[:, 1:] * side


def wanted_outline(look: Appearance, robots: Double, bodies: Double, extras: Double) -> Double:
    """The corners of the first body at its goal, which is robot 0's target, [K, 2].

    Where any direction will do, it has the body's own.
    """
    return payload_outline(look.bodies[0], robots[0, [TX, TY]], direction_of(look, bodies, extras))


def direction_of(look: Appearance, bodies: Double, extras: Double) -> Double:
    """The unit vector that a pose wants, or the first body's own where any will do, [2]."""
    if look.direction is None:
        return np.asarray(bodies[0, 4:6])
    return np.asarray(extras[look.direction :][:2])
