"""The controller a robotics engineer would write: waypoints from a map, then reciprocal avoidance.

Each robot, on its own, in each step:

1. aims at the farthest visible point of its way to the goal (`planner`), and brakes near the goal;
2. turns its aim to the right while another robot is close ahead, which breaks the symmetry that
   stalls reciprocal avoidance head-on;
3. takes the velocity nearest to its aim that is safe (`orca`). Surfaces are hard limits: it may
   approach them only so fast that it can still brake. Robots are soft limits, shared half and half;
4. turns that velocity into a command of its drive (`tracking`).

Half and half fails at one place: a robot that rests at its goal in a passage sees no reason to
leave, and the other waits for ever. So there is a right of way: a robot within `avoidance.NEAR` of
its goal gives way to every robot that has farther to go. Besides its half, it makes room for the
velocity that the other *wants*, all by itself, so that a robot that was brought to a halt gets its
way too.

All times and distances are those of the default robot, scaled for others (`agility`).
"""

import numpy as np

from swarmdata.behavior_policies.navigation.navigator import Navigator, turned_right
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

__all__ = ["Scripted", "actions_of", "turned_right"]


class Scripted:
    """Drives every robot to its target: ways on a map, reciprocal avoidance, any drive.

    It knows more than the robots see: the map (`step.layouts`) and the positions, velocities and
    targets of all robots (`step.states`). It sends no messages.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        self._noise = check_noise(noise)
        self._last = LastMeans()
        self._action_size = spec.action_size
        self._navigator = Navigator(spec)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`."""
        self._navigator.reset(step, copies)

    def act(self, step: Step) -> Float:
        commands = self._last.keep(step, self._navigator.commands(step))
        return actions_of(commands, step, self._noise, self._action_size)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self._last.require(step), actions, self._noise)


def actions_of(commands: Double, step: Step, noise: float, action_size: int) -> Float:
    """Returns commands [E, N, 2] with noise, then zeros for messages, as actions [E, N, A]."""
    actions = np.zeros((*commands.shape[:2], action_size), dtype=np.float32)
    actions[..., :2] = add_noise(commands, step, noise)
    return actions
