"""The controller a robotics engineer would write: waypoints from a map, then reciprocal avoidance.

In each step, each robot independently:

1. aims at the farthest visible point of its path to the goal (`planner`), and brakes near the goal;
2. turns its aim to the right while another robot is close ahead, which breaks the symmetry that
   stalls reciprocal avoidance head-on;
3. takes the velocity nearest to its aim that is safe (`orca`). Surfaces are hard limits: it may
   approach them only so fast that it can still brake. Robots are soft limits, shared half and half;
4. turns that velocity into a command of its drive (`velocity_tracking`).

Sharing half and half fails in one case: a robot that rests at its goal in a passage has no reason
to leave, and another robot waits there for ever. So there is a right of way: a robot within
`avoidance.GIVE_WAY_DISTANCE` of its goal gives way to every robot that has farther to go. Besides
its half, it makes all the room for the velocity that the other robot *wants*, so that a robot that
was brought to a halt can move on.

All times and distances are those of the default robot, scaled for others (`robot_scales`).
"""

from swarmdata.behavior_policies.navigation.navigator import Navigator
from swarmdata.behavior_policies.noise import Controller
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Int, Step


class Scripted(Controller):
    """Drives every robot to its target: paths on a map, reciprocal avoidance, any drive.

    It knows more than the robots observe: the map (`step.layouts`) and the positions, velocities
    and targets of all robots (`step.states`). It sends no messages.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise)
        self._navigator = Navigator(spec)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`."""
        self._navigator.reset(step, copies)

    def commands(self, step: Step) -> Double:
        return self._navigator.commands(step)
