"""Drives robots to points that may move: by paths on a map, reciprocal avoidance, commands."""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import (
    AVOIDANCE_HORIZON,
    ROBOT_GAP,
    robot_half_planes,
    stopping_half_planes,
    surface_half_planes,
)
from swarmdata.behavior_policies.navigation.episode_maps import NODE_SPACING, EpisodeMaps, Maps
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, Team
from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.envs.physics.dynamics import SPEED, UNICYCLE
from swarmdata.numerics.distance_field import Ground, Int32
from swarmdata.numerics.waypoints import UNPLANNED_COST, Paths, waypoint
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Int, Step

TURN_DISTANCE = 1.0  # m between centres below which a robot turns right for another
TURN_COS, TURN_SIN = 0.955336489125606, 0.29552020666133955  # of 0.3 rad, to the right
TARGET_REPLAN_DISTANCE = 0.1  # m that a target moves before the path to it is planned anew


@kernel
def turned_right(
    i: int, robots: Double, aim: tuple[float, float], near: float = TURN_DISTANCE
) -> tuple[float, float]:
    """Returns the aim (m/s) of robot i, turned 0.3 rad right if one within `near` (m) is ahead."""
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        if j != i and x * x + y * y < near * near and x * aim[0] + y * aim[1] > 0.0:
            return TURN_COS * aim[0] + TURN_SIN * aim[1], TURN_COS * aim[1] - TURN_SIN * aim[0]
    return aim


@kernel
def write_aim(
    i: int, robot: Double, drift: Double, team: Team, ground: Ground, paths: Paths, out: Double
) -> None:
    """Writes the velocity a robot would take alone, m/s, and its distance to the target, m, [3].

    `robot`: x, y, vx, vy, target x and y first. `drift`: velocity of the target, m/s, [2], which is
    added while the target is in sight.
    """
    x, y, goal, max_speed = robot[0], robot[1], robot[4:6], team.limits[i, SPEED]
    to_x, to_y = waypoint((x, y), goal, team.radii[i], ground, paths)
    dx, dy = to_x - x, to_y - y
    d = math.sqrt(dx * dx + dy * dy)
    gx, gy = goal[0] - x, goal[1] - y
    out[2] = math.sqrt(gx * gx + gy * gy)
    speed = min(max_speed, APPROACH_RATE / team.scales[i, TIME_SCALE] * out[2])
    out[0], out[1] = dx * (speed / max(d, 1e-9)), dy * (speed / max(d, 1e-9))
    is_in_sight = to_x == goal[0] and to_y == goal[1]
    if is_in_sight and (drift[0] != 0.0 or drift[1] != 0.0):
        out[0], out[1] = out[0] + drift[0], out[1] + drift[1]
        norm = max(math.sqrt(out[0] * out[0] + out[1] * out[1]) / max_speed, 1.0)
        out[0], out[1] = out[0] / norm, out[1] / norm


@kernel
def _forget_old_paths(targets: Double, goals: Double, costs: Int32, are_old: Bool) -> None:
    """Forgets paths to targets that moved; after a reset, by however little."""
    for i in range(targets.shape[0]):
        dx, dy = targets[i, 0] - goals[i, 0], targets[i, 1] - goals[i, 1]
        reach = 0.0 if are_old[i] else TARGET_REPLAN_DISTANCE
        has_moved, are_old[i] = dx * dx + dy * dy > reach * reach, False
        if costs[i, 0] == UNPLANNED_COST or has_moved:
            goals[i, 0], goals[i, 1] = targets[i, 0], targets[i, 1]
            costs[i, 0] = UNPLANNED_COST


@kernel
def navigate(all_robots: Double, drifts: Double, team: Team, maps: Maps, out: Double) -> None:
    """Writes the commands of all robots of all copies, in [-1, 1], [E, N, 2].

    `all_robots`: x, y, vx, vy, target x and y, heading ux and uy, [E, N, 8]. `drifts`: velocities
    of the targets, m/s, [E, N, 2].
    """
    n_robots, limits, rule = all_robots.shape[1], team.limits, (AVOIDANCE_HORIZON, ROBOT_GAP)
    planes = np.empty((maps.primitives.shape[1] + 4 + 3 * n_robots, 4))
    aims = np.empty((n_robots, 3))
    for b in range(all_robots.shape[0]):
        robots, primitives = all_robots[b], maps.primitives[b]
        ground = Ground(maps.clearances[b], maps.half, NODE_SPACING)
        _forget_old_paths(robots[:, 4:6], maps.goals[b], maps.costs[b], maps.are_old[b])
        for i in range(n_robots):
            paths = Paths(maps.costs[b, i], maps.next_nodes[b, i])
            write_aim(i, robots[i], drifts[b, i], team, ground, paths, aims[i])
        for i in range(n_robots):
            time, length = team.scales[i, TIME_SCALE], team.scales[i, LENGTH_SCALE]
            n_hard = surface_half_planes(
                robots[i, 0], robots[i, 1], team.radii[i], primitives, maps.half, planes,
                time, length,
            )  # fmt: skip
            if limits[i, UNICYCLE] == 1.0:
                n_hard = stopping_half_planes(i, robots, team, n_hard, planes)
            n = robot_half_planes(i, robots, team.radii, team.scales, aims, rule, n_hard, planes)
            aim = turned_right(i, robots, (aims[i, 0], aims[i, 1]), TURN_DISTANCE * length)
            wish = solve(planes, n, n_hard, limits[i, SPEED], aim)
            velocity, heading = (robots[i, 2], robots[i, 3]), (robots[i, 6], robots[i, 7])
            dt = team.control_dt
            command_of(velocity, heading, wish, limits[i], planes, n, dt, out[b, i])


class Navigator:
    """Gives commands that drive the robots of E episodes, which may differ in every way, to points.

    It knows the map (`step.layouts`), without movable bodies, and all robots (`step.states`).

    Raises:
        SpecError: the arena is too large to be mapped.
    """

    def __init__(self, spec: TaskSpec) -> None:
        self._n_agents, self._team = spec.n_agents, Team.of(spec)
        self._maps = EpisodeMaps(spec, spec.n_agents, float(self._team.radii.max()))

    def reset(self, step: Step, copies: Int) -> None:
        self._maps.reset(step, copies)

    def commands(
        self, step: Step, targets: Double | None = None, drifts: Double | None = None
    ) -> Double:
        """Returns commands that drive every robot to its target, [E, N, 2].

        Targets, m, are those in the states unless given, [E, N, 2]; drifts their velocities, m/s,
        [E, N, 2], None if they rest.
        """
        maps = self._maps.maps
        states = robots_of(step.states, self._n_agents).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY, TX, TY, UX, UY]])
        if targets is not None:
            robots[..., 4:6] = targets
        commands = np.empty((len(robots), self._n_agents, 2))
        drifts = np.zeros_like(commands) if drifts is None else drifts
        navigate(robots, np.ascontiguousarray(drifts, np.float64), self._team, maps, commands)
        return commands
