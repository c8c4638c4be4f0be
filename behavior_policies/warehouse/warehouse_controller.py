"""The controller a warehouse engineer would write: traffic rules, brakes, and a right of way.

In each step, each robot independently:

1. steers at a point of its route (`traffic_routes`), at full speed;
2. takes the safe velocity nearest to that (`traffic`);
3. gives way. Where tracks cross and where robots turn round, two robots that each avoid half can
   wait for each other for ever. So besides its half, a robot makes all the room for the velocity
   that a robot with a lower number wants: of each pair one always has the right of way.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.robot_scales import Team
from swarmdata.behavior_policies.navigation.traffic import TrafficController, drive_in_traffic
from swarmdata.behavior_policies.warehouse.traffic_routes import Roads, roads_of, steer
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float


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


class WarehouseController(TrafficController):
    """Drives on routes of the floor plan, with a right of way.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation, or the spec is another task's.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise, act_copies, roads_of(spec))
