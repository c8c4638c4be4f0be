"""The controller of `intersection`: robots steer along their lanes, or halt at their stop lines.

Nobody gives way in `traffic`, since `right_of_way` has decided already.
"""

import math

import numpy as np

from swarmdata.behavior_policies.intersection.right_of_way import Rules, steer
from swarmdata.behavior_policies.navigation.robot_scales import TIME_SCALE, Team
from swarmdata.behavior_policies.navigation.traffic import TrafficController, drive_in_traffic
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.envs.intersection.intersection import CROSSING, N_EXTRAS, WAIT
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float


@kernel
def act_copies(
    all_robots: Double, team: Team, half: Double, layouts: Float, rules: Rules, out: Double
) -> None:
    """Writes the commands of all robots of all copies, in [-1, 1], [E, N, 2].

    `all_robots`: x, y, vx, vy, target x and y, heading ux and uy, crossing, wait, [E, N, 10].
    """
    limits, n_robots = team.limits, all_robots.shape[1]
    aims = np.empty((n_robots, 3))
    for b in range(all_robots.shape[0]):
        robots = all_robots[b]
        for i in range(n_robots):
            x, y = robots[i, 0], robots[i, 1]
            to_x, to_y = steer(i, robots, rules)
            d = max(math.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)), 1e-9)
            speed = min(limits[i, SPEED] / d, APPROACH_RATE / team.scales[i, TIME_SCALE])
            aims[i, 0], aims[i, 1] = (to_x - x) * speed, (to_y - y) * speed
            aims[i, 2] = 0.0  # nobody gives way here: `right_of_way` has decided already
        drive_in_traffic(robots, aims, team, half, layouts[b], out[b])


class IntersectionController(TrafficController):
    """Drives on the lanes of the arms, first come, first served; it knows the robots' schedules.

    Arguments and errors are those of `Scripted`; a spec of another task is refused too.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise, act_copies, Rules.of(spec))

    def _robots(self, states: Float) -> Double:
        extras = states[:, N_COLUMNS * self._n_agents :].reshape(-1, self._n_agents, N_EXTRAS)
        schedule = extras[..., [CROSSING, WAIT]].astype(np.float64)
        return np.concatenate([super()._robots(states), schedule], axis=-1)
