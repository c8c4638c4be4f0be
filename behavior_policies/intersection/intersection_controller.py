"""The controller of `intersection`: right-hand lanes, and who may enter the middle square.

A movement is a pair of arms, from and to; two conflict if their paths come closer than two robots
may. A robot halts at the stop line before the middle square while a robot inside has a conflicting
movement; while one nearer to its own stop line has (first come, first served; of equals the lower
number); and while its exit arm is full. The robot nearest to its stop line waits for robots inside
and for a place only, and these move on. So robots that keep to the rules do not block each other.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from swarmdata.behavior_policies.navigation.robot_scales import TIME_SCALE, Team
from swarmdata.behavior_policies.navigation.traffic import TrafficController, drive_in_traffic
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.envs.intersection.intersection import CROSSING, N_EXTRAS, WAIT
from swarmdata.envs.intersection.junction import ARM_DIRECTIONS, N_ARMS, Junction, arm_at
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float

STOP_GAP = 0.08  # gap (m) between a robot at its stop line and the middle square
ENTRY_DISTANCE = 0.06  # m behind its stop line at which a robot counts as inside
QUEUE_GAP = 0.1  # gap (m) between robots that stand in a lane
CONFLICT_GAP = 0.12  # gap (m) between robots below which their movements conflict
STEERING_DISTANCE = 0.35  # m along its lane at which a robot steers
TURN_DISTANCE = 0.08  # m from the lane that it turns into at which a robot steers along it
GATE_DISTANCE = 0.35  # m from the gates below which a robot drives to its entry directly
N_PATH_POINTS = 64  # points of each path that are compared with those of the others

OUTSIDE, APPROACHING, INSIDE = range(3)
"""Where a robot is: on no way to the middle square, on the way, or in it."""


class Rules(NamedTuple):
    """Where robots drive, and which movements conflict."""

    entries: Double  # [4, 2] of the junction
    exits: Double  # [4, 2] of the junction
    directions: Double  # [4, 2] from the middle to the end of each arm
    half_width: float  # m, of the middle square
    stop_line: float  # m from the middle along an arm
    capacity: int  # robots that fit in a lane of an arm
    conflicts: Bool  # [16, 16] of each pair of movements, from * 4 + to

    @classmethod
    def of(cls, spec: TaskSpec) -> Self:
        """The rules on the floor of a spec; one of another task raises a `SpecError`."""
        junction, radius = Junction.of(spec), max(robot.radius for robot in spec.robots)
        stop_line = junction.half_width + radius + STOP_GAP
        length = float(np.abs(junction.exits).max(1).min()) - stop_line
        capacity = 1 + int(length / (2 * radius + QUEUE_GAP))
        conflicts = find_conflicts(junction, stop_line, 2 * radius + CONFLICT_GAP)
        return cls(
            junction.entries, junction.exits, ARM_DIRECTIONS, junction.half_width, stop_line,
            capacity, conflicts,
        )  # fmt: skip


def find_conflicts(junction: Junction, stop_line: float, apart: float) -> Bool:
    """Which movements of different arms come closer than `apart` (m), [16, 16]."""
    conflicts = np.zeros((N_ARMS**2, N_ARMS**2), dtype=np.bool_)
    pairs = [(a, b) for a in range(N_ARMS) for b in range(N_ARMS) if a != b]
    paths = {pair: movement_path(junction, stop_line, *pair) for pair in pairs}
    for first in pairs:
        for second in pairs:
            gaps = paths[first][:, None] - paths[second]
            is_close = np.square(gaps).sum(-1).min() < apart * apart
            codes = tuple(N_ARMS * a + b for a, b in (first, second))
            conflicts[codes] = is_close and first[0] != second[0]
    return conflicts


def movement_path(junction: Junction, stop_line: float, start: int, end: int) -> Double:
    """Points from the stop line of one arm to that of another, along both lanes, [P, 2]."""
    into, out = ARM_DIRECTIONS[start], ARM_DIRECTIONS[end]
    first = junction.entries[start] * (1 - np.abs(into)) + stop_line * into
    last = junction.exits[end] * (1 - np.abs(out)) + stop_line * out
    corner = np.where(into == 0.0, first, last)  # the lane's coordinate, then that of the other
    ways = [
        a + (b - a) * np.linspace(0.0, 1.0, N_PATH_POINTS)[:, None]
        for a, b in ((first, corner), (corner, last))
    ]
    return np.concatenate(ways)


@kernel
def movement_of(robot: Double, rules: Rules) -> tuple[int, int, float]:
    """Where a robot is, its movement, and its distance from its stop line, m.

    `robot`: x, y, vx, vy, target x and y, heading ux and uy, crossing, wait, [10].
    """
    x, y = robot[0], robot[1]
    arm, goal = arm_at(x, y), arm_at(robot[4], robot[5])
    along = rules.directions[arm, 0] * x + rules.directions[arm, 1] * y
    if robot[8] == 0.0 or (arm == goal and along > rules.half_width):  # it drives away
        return OUTSIDE, 0, 0.0
    if along > rules.stop_line - ENTRY_DISTANCE:
        return APPROACHING, N_ARMS * arm + goal, along - rules.stop_line
    return INSIDE, N_ARMS * came_from(robot, goal, rules) + goal, 0.0


@kernel
def came_from(robot: Double, goal: int, rules: Rules) -> int:
    """The arm whose lane a robot inside is on; once it is on that of its goal, the opposite arm."""
    x, y = robot[0], robot[1]
    to_x, to_y = rules.exits[goal, 0], rules.exits[goal, 1]
    is_across = goal % 2 == 0  # whether it leaves along x
    aside = abs(y - to_y) if is_across else abs(x - to_x)
    if aside <= TURN_DISTANCE:
        return (goal + 2) % N_ARMS
    if is_across:
        return 3 if to_y > y else 1
    return 2 if to_x > x else 0


@kernel
def may_enter(i: int, robots: Double, rules: Rules) -> bool:
    """Whether robot i of `robots` [N, 10], which approaches the middle square, may enter it."""
    _, movement, distance = movement_of(robots[i], rules)
    n_ahead = 0
    for j in range(robots.shape[0]):
        place, other, far = movement_of(robots[j], rules)
        is_there = place == OUTSIDE and arm_at(robots[j, 0], robots[j, 1]) == movement % N_ARMS
        is_bound = place == INSIDE and other % N_ARMS == movement % N_ARMS
        n_ahead += is_there or is_bound
        if n_ahead >= rules.capacity:
            return False
        if j == i or place == OUTSIDE or not rules.conflicts[movement, other]:
            continue
        is_first = far < distance or (far == distance and j < i)
        if place == INSIDE or is_first:
            return False
    return True


@kernel
def steer(i: int, robots: Double, rules: Rules) -> tuple[float, float]:
    """Where robot i of `robots` [N, 10] steers, m; its own place if it has to wait there."""
    robot = robots[i]
    x, y, tx, ty = robot[0], robot[1], robot[4], robot[5]
    arm, goal = arm_at(x, y), arm_at(tx, ty)
    ux, uy = rules.directions[arm, 0], rules.directions[arm, 1]
    along = ux * x + uy * y
    if robot[8] == 0.0:
        return _to_entry(i, robots, along, rules)
    place, _, distance = movement_of(robot, rules)
    if place == APPROACHING:
        ahead = max(along - STEERING_DISTANCE, 0.0)
        if distance < STEERING_DISTANCE and not may_enter(i, robots, rules):
            ahead = rules.stop_line
        lane = rules.entries[arm]  # its coordinate across the arm is that of the lane
        return ahead * ux + lane[0] * abs(uy), ahead * uy + lane[1] * abs(ux)
    gx, gy = rules.directions[goal, 0], rules.directions[goal, 1]
    aside = abs(gx) * (ty - y) + abs(gy) * (tx - x)
    if place == INSIDE and abs(aside) > TURN_DISTANCE:
        return (x, ty) if goal % 2 == 0 else (tx, y)
    ahead = gx * x + gy * y + STEERING_DISTANCE
    if ahead > gx * tx + gy * ty:
        return tx, ty
    return ahead * gx + tx * abs(gy), ahead * gy + ty * abs(gx)


@kernel
def _to_entry(i: int, robots: Double, along: float, rules: Rules) -> tuple[float, float]:
    """Where a robot steers that has to get to its entry: out on the right, and to it if free."""
    x, y, tx, ty = robots[i, 0], robots[i, 1], robots[i, 4], robots[i, 5]
    arm = arm_at(tx, ty)
    ux, uy = rules.directions[arm, 0], rules.directions[arm, 1]
    end = ux * tx + uy * ty
    lane = rules.exits[arm]
    away = (tx - x) * (tx - x) + (ty - y) * (ty - y)
    for j in range(robots.shape[0]):
        dx, dy = tx - robots[j, 0], ty - robots[j, 1]
        if j != i and dx * dx + dy * dy < min(away, GATE_DISTANCE * GATE_DISTANCE):
            ahead = min(along + STEERING_DISTANCE, end)
            return ahead * ux + lane[0] * abs(uy), ahead * uy + lane[1] * abs(ux)
    if end - along < GATE_DISTANCE:
        return tx, ty
    ahead = along + STEERING_DISTANCE
    return ahead * ux + lane[0] * abs(uy), ahead * uy + lane[1] * abs(ux)


@kernel
def act_copies(
    all_robots: Double, team: Team, half: Double, layouts: Float, rules: Rules, out: Double
) -> None:
    """Writes the commands of all robots of all copies, in [-1, 1], [E, N, 2].

    `all_robots`: x, y, vx, vy, target x and y, heading ux and uy, crossing, wait, [E, N, 10].
    `layouts`: corners, [E, 4, 8].
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
            aims[i, 2] = 0.0  # nobody gives way here: `may_enter` has decided already
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
