"""The controller a warehouse engineer would write: traffic rules, brakes, and a right of way.

Each robot steers at a point of its route, takes the safe velocity nearest to that (`traffic`), and
makes all the room for what a robot with a lower number wants: of each pair one has the right of
way, so that none wait for each other for ever.

Where two robots fit abreast in an aisle, routes are shortest paths (`floor_plan.best_lane`) on
right-hand tracks, a quarter of the width from the middle. Narrower aisles are one-way: odd ones to
the right, even ones to the left. A robot enters by the last lane before its target, leaves by the
next one in the aisle's direction, and changes lanes through the front.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmdata.behavior_policies.navigation.robot_scales import Team
from swarmdata.behavior_policies.navigation.traffic import TrafficController, drive_in_traffic
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.envs.warehouse.floor_plan import STANDOFF_GAP, FloorPlan, best_lane, corridor
from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

STEERING_DISTANCE = 0.4  # m along its track at which a robot steers
TARGET_APPROACH_DISTANCE = 0.45  # m from its target below which a robot leaves the track for it
PASSING_CLEARANCE = 0.1  # m that two robots need besides their diameters to pass in an aisle


class Roads(NamedTuple):
    """Where robots may drive."""

    lanes: Double  # [L, 2] of the plan
    rows: Double  # [3] of the plan
    middles: Double  # [aisles + 1] of the plan
    offsets: Double  # [3] m from the middle to the track in the front, in aisles and in lanes
    is_one_way: bool  # whether aisles are one-way


@kernel
def lane_at(x: float, lanes: Double) -> int:
    """The lane that x is in, or -1."""
    for k in range(lanes.shape[0]):
        if lanes[k, 0] < x < lanes[k, 1]:
            return k
    return -1


@kernel
def lane_along(x: float, lanes: Double, sign: float) -> int:
    """The first lane whose middle lies beyond x in the direction `sign`, or else the last lane."""
    n = lanes.shape[0]
    for step in range(n):
        k = step if sign > 0.0 else n - 1 - step
        if (0.5 * (lanes[k, 0] + lanes[k, 1]) - x) * sign > 0.0:
            return k
    return n - 1 if sign > 0.0 else 0


@kernel(inline="always")
def one_way(aisle: int) -> float:
    """Direction of traffic in a narrow aisle: 1 to the right, -1 to the left."""
    return 1.0 if aisle % 2 == 1 else -1.0


@kernel
def steer(x: float, y: float, target: tuple[float, float], roads: Roads) -> tuple[float, float]:
    """Returns the point that a robot at (x, y) steers at on its route to its target, m."""
    lanes, rows, middles, offsets, is_one_way = roads
    current, final = corridor(y, rows), corridor(target[1], rows)
    lane = lane_at(x, lanes)
    has_passed = is_one_way and final > 0 and (target[0] - x) * one_way(final) < 0.0
    if current == final and not has_passed:
        if current == 0 or abs(target[0] - x) < TARGET_APPROACH_DISTANCE:
            return target
        sign = 1.0 if target[0] > x else -1.0
        return x + sign * STEERING_DISTANCE, middles[current] - sign * offsets[1]
    goal, k = final, lane
    if not is_one_way:
        k = best_lane(x, target[0], lanes)
    elif lane < 0 and current > 0:
        k = lane_along(x, lanes, one_way(current))
    elif final > 0:
        k = lane_along(target[0], lanes, -one_way(final))
        if lane >= 0 and lane != k and current != 0:
            goal, k = 0, lane  # the route to another lane leads through the front
    middle = 0.5 * (lanes[k, 0] + lanes[k, 1])
    if lane == k:
        sign = 1.0 if middles[goal] > y else -1.0
        return middle + sign * offsets[2], y + sign * STEERING_DISTANCE
    sign = 1.0 if middle > x else -1.0
    offset = offsets[0 if current == 0 else 1]
    return x + sign * STEERING_DISTANCE, middles[current] - sign * offset


def roads_of(spec: TaskSpec) -> Roads:
    """The roads on the floor plan of a spec; one of another task raises a `SpecError`."""
    rules, radius = spec.rules_as(WarehouseRules), max(robot.radius for robot in spec.robots)
    widths = np.array([rules.front, rules.aisle_width, rules.lane_width])
    offsets = np.minimum(widths / 4, widths / 2 - radius - STANDOFF_GAP)
    offsets[widths < 4 * radius + PASSING_CLEARANCE] = 0.0
    plan = FloorPlan.of(spec)
    return Roads(plan.lanes, plan.rows, plan.middles, offsets, bool(offsets[1] == 0.0))


@kernel
def act_copies(
    all_robots: Double, team: Team, half: Double, layouts: Float, roads: Roads, out: Double
) -> None:
    """Writes the commands of all robots of all copies, in [-1, 1], [E, N, 2].

    `all_robots`: x, y, vx, vy, target x and y, heading ux and uy, [E, N, 8]. `layouts`: shelves,
    [E, M, 8].
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

    Arguments and errors are those of `Scripted`; a spec of another task is refused too.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise, act_copies, roads_of(spec))
