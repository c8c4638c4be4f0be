"""The controller a warehouse engineer would write: traffic rules, brakes, and a right of way.

In each step, each robot independently:

1. steers at a point of its route (`traffic_routes`), at full speed;
2. takes the safe velocity nearest to that (`orca`). Hard limits: it approaches surfaces and robots
   only so fast that it can still brake (`avoidance.BRAKING_TIME`). Soft limits: reciprocal
   avoidance, half and half;
3. gives way. Where tracks cross and where robots turn round, two robots that each avoid half can
   wait for each other for ever. So besides its half, a robot makes all the room for the velocity
   that a robot with a lower number wants: of each pair one always has the right of way.

`velocity_tracking` turns the velocity into a command, so robots of every drive can be mixed.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.robot_scales import Team
from swarmdata.behavior_policies.navigation.traffic import drive_in_traffic
from swarmdata.behavior_policies.noise import NoisyCommands
from swarmdata.behavior_policies.warehouse.traffic_routes import Roads, roads_of, steer
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step


@kernel
def act_copies(
    all_robots: Double, team: Team, half: Double, layouts: Float, roads: Roads, out: Double
) -> None:
    """Writes the commands of all robots of all copies.

    Args:
        all_robots: x, y, vx, vy, target x and y, heading ux and uy, [E, N, 8].
        team: constants of the robots.
        half: half width and half height of the arena, m, [2].
        layouts: shelves, [E, M, 8].
        roads: of the floor plan.
        out: written, in [-1, 1], [E, N, 2].
    """
    limits, n_robots = team.limits, all_robots.shape[1]
    aims = np.empty((n_robots, 3))
    for b in range(all_robots.shape[0]):
        robots = all_robots[b]
        for i in range(n_robots):
            x, y, target = robots[i, 0], robots[i, 1], (robots[i, 4], robots[i, 5])
            to_x, to_y = steer(x, y, target, roads)
            d = max(math.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)), 1e-9)
            speed = limits[i, SPEED] / d
            aims[i, 0], aims[i, 1] = (to_x - x) * speed, (to_y - y) * speed
            aims[i, 2] = -i  # in place of a distance: the lower number has the right of way
        drive_in_traffic(robots, aims, team, half, layouts[b], out[b])


class WarehouseController:
    """Drives on routes of the floor plan, with a right of way.

    It knows the floor plan, and the positions, velocities and targets of all robots
    (`step.states`).

    Args:
        spec: the task; its robots may differ from each other in every way.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation, or the spec is another task's.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        self._roads, self._noisy = roads_of(spec), NoisyCommands(spec, noise)
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self._team, self._n_agents = Team.of(spec), spec.n_agents

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        return self._noisy.actions(step, self._commands(step))

    def log_probs(self, step: Step, actions: Float) -> Float:
        return self._noisy.log_probs(step, actions, self._commands)

    def _commands(self, step: Step) -> Double:
        states = robots_of(step.states, self._n_agents).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY, TX, TY, UX, UY]])
        commands = np.empty((*robots.shape[:2], 2))
        act_copies(robots, self._team, self._half, step.layouts, self._roads, commands)
        return commands
