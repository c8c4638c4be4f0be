"""Three policies without skill: stand still, move at random, drive straight at the goal."""

import numpy as np

from swarmdata.behavior_policies.noise import counters
from swarmdata.seeding import uniform
from swarmdata.spec import TaskSpec
from swarmdata.states import TX, Y, robots_of
from swarmdata.types import Double, Float, Int, Step

APPROACH_RATE = 2.0
"""Commanded speed per metre of distance to the goal, 1/s: robots brake over the last 0.3 m."""


class Idle:
    """Every robot commands zero velocity."""

    uses_state = False

    def __init__(self, spec: TaskSpec) -> None:
        self._shape = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        return np.zeros((len(step.seeds), *self._shape), dtype=np.float32)


class Random:
    """Every robot draws its command uniformly from [-1, 1]^2, anew in each step."""

    uses_state = False

    def __init__(self, spec: TaskSpec) -> None:
        self._shape = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        draws = uniform(counters(step, "policy", *self._shape))
        return (2.0 * draws - 1.0).astype(np.float32)


class Straight:
    """Every robot drives straight at its goal and brakes near it; it avoids nothing.

    It reads positions and goals from `step.states`, so that it is the same policy under every
    observation model.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec) -> None:
        self._max_speeds = np.array([[robot.max_speed] for robot in spec.robots])  # [N, 1]
        self._shape = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        robots = robots_of(step.states, self._shape[0]).astype(np.float64)
        command = APPROACH_RATE * (robots[..., TX:] - robots[..., : Y + 1]) / self._max_speeds
        actions = np.zeros((len(robots), *self._shape), dtype=np.float32)
        actions[..., :2] = clip_norm(command)
        return actions


def clip_norm(vectors: Double) -> Double:
    """Returns planar vectors shortened to length 1 where they are longer, [..., 2].

    Only `+ * /` and `sqrt` are used, so the bits are the same on every platform.
    """
    squares = vectors[..., 0:1] * vectors[..., 0:1] + vectors[..., 1:2] * vectors[..., 1:2]
    return vectors / np.maximum(1.0, np.sqrt(squares))
