"""Three simple policies: stand still, move at random, drive straight to the goal."""

import numpy as np

from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, scales_of
from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.noise import Controller, counters
from swarmdata.envs.physics.dynamics import ACCELERATION, BY_VELOCITY, SPEED, UNICYCLE, limits_of
from swarmdata.numerics.random import uniform
from swarmdata.rollouts.action_probabilities import noisy_log_probs, uniform_log_probs
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, UX, UY, VX, VY, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

APPROACH_RATE = 2.0  # 1/s, commanded speed per metre to the goal: robots brake over 0.3 m


class Idle(Controller):
    """Every robot commands zero velocity."""

    uses_state = has_memory = False

    def __init__(self, spec: TaskSpec) -> None:
        super().__init__(spec)
        self._n_agents = spec.n_agents

    def commands(self, step: Step) -> Double:
        return np.zeros((len(step.seeds), self._n_agents, 2))


class Random:
    """Every robot draws its command uniformly from [-1, 1]^2 in each step."""

    uses_state = False

    def __init__(self, spec: TaskSpec) -> None:
        self._shape = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        draws = uniform(counters(step, "policy", *self._shape))
        return (2.0 * draws - 1.0).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return uniform_log_probs(actions)


class Straight(Controller):
    """Every robot drives straight to its target and brakes near it; it avoids nothing.

    It reads `step.states`, so that it is the same policy with every observation model.
    """

    has_memory = False

    def __init__(self, spec: TaskSpec) -> None:
        super().__init__(spec)
        self._n_agents = spec.n_agents
        self._limits, self._dt = limits_of(spec), spec.control_dt
        self._rates = APPROACH_RATE / scales_of(spec)[:, TIME_SCALE:LENGTH_SCALE]  # [N, 1]
        self._max_speeds = self._limits[:, SPEED:ACCELERATION]  # [N, 1]

    def commands(self, step: Step) -> Double:
        robots = robots_of(step.states, self._n_agents).astype(np.float64)
        wishes = self._rates * (robots[..., TX:] - robots[..., : Y + 1]) / self._max_speeds
        commands = clip_norm(wishes)
        _track(robots, self._max_speeds * commands, self._limits, self._dt, commands)
        return commands

    def log_probs(self, step: Step, actions: Float) -> Float:
        # of `act`, which policies of others that derive from this one override
        return noisy_log_probs(self.act(step).astype(np.float64), actions, 0.0)


@kernel
def _track(robots: Double, wishes: Double, limits: Double, dt: float, commands: Double) -> None:
    """Replaces commands of all but holonomic robots with velocity commands, by wishes (m/s)."""
    no_planes = np.empty((0, 4))
    for b in range(robots.shape[0]):
        for i in range(robots.shape[1]):
            if limits[i, UNICYCLE] == 1.0 or limits[i, BY_VELOCITY] == 0.0:
                robot, wish = robots[b, i], (wishes[b, i, 0], wishes[b, i, 1])
                velocity, heading = (robot[VX], robot[VY]), (robot[UX], robot[UY])
                command_of(velocity, heading, wish, limits[i], no_planes, 0, dt, commands[b, i])


def clip_norm(vectors: Double) -> Double:
    """Returns planar vectors with longer ones shortened to length 1, [..., 2]."""
    squares = vectors[..., 0:1] * vectors[..., 0:1] + vectors[..., 1:2] * vectors[..., 1:2]
    return vectors / np.maximum(1.0, np.sqrt(squares))
