"""The controller a robotics engineer would write: waypoints from a map, then reciprocal avoidance.

In each step, each robot independently

1. aims at the farthest visible point of its path to the goal (`planner`), and brakes near the goal;
2. turns its aim to the right while another robot is close ahead, which breaks the symmetry that
   stalls reciprocal avoidance head-on;
3. takes the safe velocity nearest to its aim (`orca`): surfaces, which it approaches only so fast
   that it can still brake, are hard limits, robots soft ones, shared half and half;
4. turns that velocity into a command of its drive (`velocity_tracking`).

A robot that rests at its goal in a passage would make others wait for ever. So a robot within
`avoidance.GIVE_WAY_DISTANCE` of its goal also makes all the room for the velocity that a robot with
farther to go *wants*. Times and distances are scaled for other robots (`robot_scales`).
"""

from swarmdata.behavior_policies.navigation.navigator import Navigator
from swarmdata.behavior_policies.noise import Controller
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Int, Step


class Scripted(Controller):
    """Drives every robot to its target: paths on a map, reciprocal avoidance, any drive.

    It knows the map (`step.layouts`) and the positions, velocities and targets of all robots
    (`step.states`). It sends no messages.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation, or the arena is too large to be mapped.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise)
        self._navigator = Navigator(spec)

    def reset(self, step: Step, copies: Int) -> None:
        super().reset(step, copies)
        self._navigator.reset(step, copies)

    def commands(self, step: Step) -> Double:
        return self._navigator.commands(step)
