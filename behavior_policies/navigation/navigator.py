"""Drives robots to points: ways on a map, then reciprocal avoidance, then commands.

The reusable part of scripted controllers: a task's own controller says where each robot should be
now and, if that point moves, how fast it moves.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import (
    robot_half_planes,
    stopping_half_planes,
    surface_half_planes,
)
from swarmdata.behavior_policies.navigation.distance_field import (
    Int32,
    check_maps,
    fill_clearances,
    grid_shape,
)
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.planner import (
    UNPLANNED,
    n_primitives,
    primitives_of,
    waypoint,
)
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH, TIME, scales_of
from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.simple import APPROACH_RATE
from swarmdata.envs.physics.dynamics import ACCELERATION, SPEED, UNICYCLE, limits_of
from swarmdata.errors import SchemaError
from swarmdata.registry.components import make_task
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

CLOSE = 1.0
"""Metres between centres below which a robot turns right for another."""

COS, SIN = 0.955336489125606, 0.29552020666133955
"""Of the turn to the right, 0.3 rad."""

DELAY = 1.0
"""Control steps between what a robot sees and what its command changes."""

MOVED = 0.1
"""Metres that a target moves before the way to it is planned anew."""


@kernel
def turned_right(
    i: int, robots: Double, aim: tuple[float, float], close: float = CLOSE
) -> tuple[float, float]:
    """Returns the aim of robot i, turned 0.3 rad to the right if a robot is close ahead.

    Args:
        i: which robot.
        robots: columns of the state, at least x and y, [N, C].
        aim: preferred velocity, m/s.
        close: distance of centres, m.
    """
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        if j != i and x * x + y * y < close * close and x * aim[0] + y * aim[1] > 0.0:
            return COS * aim[0] + SIN * aim[1], COS * aim[1] - SIN * aim[0]
    return aim


@kernel
def preferred(
    robot: Double,
    body: Double,
    drift: Double,
    grid: Float,
    ways: tuple[Int32, Int32],
    half: Double,
    out: Double,
) -> None:
    """Writes the velocity a robot would take alone, m/s, and its distance to the target, m.

    Args:
        robot: x, y, vx, vy, target x and y, [at least 6].
        body: radius, m, maximum speed, m/s, and time scale, [3].
        drift: velocity of the target, m/s, [2]; added while the target is in sight.
        grid: clearances, m, [rows, columns].
        ways: costs and next nodes, each [n].
        half: half width and half height of the arena, m, [2].
        out: written, [3].
    """
    x, y, goal = robot[0], robot[1], robot[4:6]
    to_x, to_y = waypoint((x, y), goal, body[0], grid, ways, half)
    dx, dy = to_x - x, to_y - y
    d = math.sqrt(dx * dx + dy * dy)
    gx, gy = goal[0] - x, goal[1] - y
    out[2] = math.sqrt(gx * gx + gy * gy)
    speed = min(body[1], APPROACH_RATE / body[2] * out[2])
    out[0], out[1] = dx * (speed / max(d, 1e-9)), dy * (speed / max(d, 1e-9))
    is_in_sight = to_x == goal[0] and to_y == goal[1]
    if is_in_sight and (drift[0] != 0.0 or drift[1] != 0.0):
        out[0], out[1] = out[0] + drift[0], out[1] + drift[1]
        norm = max(math.sqrt(out[0] * out[0] + out[1] * out[1]) / body[1], 1.0)
        out[0], out[1] = out[0] / norm, out[1] / norm


@kernel
def _keep_ways(targets: Double, planned: Double, costs: Int32) -> None:
    """Forgets the ways of one copy's robots whose targets have moved."""
    for i in range(targets.shape[0]):
        dx, dy = targets[i, 0] - planned[i, 0], targets[i, 1] - planned[i, 1]
        if costs[i, 0] == UNPLANNED or dx * dx + dy * dy > MOVED * MOVED:
            planned[i] = targets[i]
            costs[i, 0] = UNPLANNED


@kernel
def navigate(
    robots: Double,
    drifts: Double,
    team: tuple[Double, Double, Double, Double, float],
    half: Double,
    maps: tuple[Float, Float, Int32, Int32, Double],
    out: Double,
) -> None:
    """Writes the commands of all robots of all copies.

    Args:
        robots: x, y, vx, vy, target x and y, heading ux and uy, [E, N, 8].
        drifts: velocities of the targets, m/s, [E, N, 2].
        team: radius, m, maximum speed, m/s, and time scale, [N, 3]; rows of `dynamics.limits_of`,
            [N, 5]; scales of time and length, [N, 2]; time to stop, s, [N]; control step, s.
        half: half width and half height of the arena, m, [2].
        maps: convex obstacles [E, P, 8]; clearances [E, rows, columns]; costs and next nodes of
            the ways, each [E, N, n]; the targets they lead to, [E, N, 2].
        out: written, in [-1, 1], [E, N, 2].
    """
    primitives, grids, costs, ways, planned = maps
    bodies, limits, scales, brakes, dt = team
    n_robots = robots.shape[1]
    planes = np.empty((primitives.shape[1] + 4 + 3 * n_robots, 4))
    aims = np.empty((n_robots, 3))
    for b in range(robots.shape[0]):
        now = robots[b]
        _keep_ways(now[:, 4:6], planned[b], costs[b])
        for i in range(n_robots):
            way = (costs[b, i], ways[b, i])
            preferred(now[i], bodies[i], drifts[b, i], grids[b], way, half, aims[i])
        for i in range(n_robots):
            n_hard = surface_half_planes(
                now[i, 0], now[i, 1], bodies[i, 0], primitives[b], half, planes,
                scales[i, TIME], scales[i, LENGTH],
            )  # fmt: skip
            if limits[i, UNICYCLE] == 1.0:
                n_hard = stopping_half_planes(i, now, bodies, brakes, n_hard, planes)
            n = robot_half_planes(i, now, bodies[:, 0], aims, n_hard, planes, scales)
            wish = (aims[i, 0], aims[i, 1])
            wish = turned_right(i, now, wish, CLOSE * scales[i, LENGTH])
            wish = solve(planes, n, n_hard, bodies[i, 1], wish)
            moving, heading = (now[i, 2], now[i, 3]), (now[i, 6], now[i, 7])
            command_of(moving, heading, wish, limits[i], planes, n, dt, out[b, i])


class Navigator:
    """Maps of E episodes, and commands that drive their robots to points.

    It knows more than the robots see: the map (`step.layouts`) and the positions, velocities and
    targets of all robots (`step.states`). Movable bodies are not on the map.

    Args:
        spec: the task; its robots may differ from each other in every way.

    Raises:
        SpecError: the arena is too large to be mapped.
    """

    def __init__(self, spec: TaskSpec) -> None:
        self._spec, self._n_agents, self._shape = spec, spec.n_agents, grid_shape(spec)
        self._n_primitives = n_primitives(make_task(spec).kinds)
        self._half = np.array([spec.arena.width / 2.0, spec.arena.height / 2.0])
        scales = scales_of(spec)
        rows = [(robot.radius, robot.max_speed) for robot in spec.robots]
        bodies = np.concatenate([np.array(rows), scales[:, TIME:LENGTH]], axis=1)
        limits = limits_of(spec)
        brakes = limits[:, SPEED] / limits[:, ACCELERATION] + DELAY * spec.control_dt
        self._team = (bodies, limits, scales, brakes, spec.control_dt)
        self._cap = float(bodies[:, 0].max()) + 0.15
        self._allocate(0)

    def _allocate(self, n_copies: int) -> None:
        """Makes room for the maps of `n_copies` episodes; none is valid yet."""
        check_maps(self._spec, max(n_copies, 1), self._n_agents)
        each = (n_copies, self._n_agents)
        nodes = self._shape[0] * self._shape[1]
        self._planned = np.zeros(n_copies, dtype=np.bool_)
        self._seeds = np.zeros(n_copies, dtype=np.uint64)
        self._maps = (
            np.zeros((n_copies, self._n_primitives, 8), dtype=np.float32),
            np.zeros((n_copies, *self._shape), dtype=np.float32),
            np.zeros((*each, nodes), dtype=np.int32),
            np.zeros((*each, nodes), dtype=np.int32),
            np.zeros((*each, 2)),
        )
        self._no_drifts = np.zeros((*each, 2))

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`."""
        if len(step.seeds) != len(self._seeds):
            self._allocate(len(step.seeds))
        primitives, grids, costs, _, _ = self._maps
        for b in copies:
            primitives[b] = primitives_of(step.layouts[b])
            fill_clearances(step.layouts[b], self._half, self._cap, grids[b])
        costs[copies, :, 0] = UNPLANNED
        self._seeds[copies], self._planned[copies] = step.seeds[copies], True

    def commands(
        self, step: Step, targets: Double | None = None, drifts: Double | None = None
    ) -> Double:
        """Commands that drive every robot to its target, [E, N, 2].

        Args:
            step: the current step.
            targets: where each robot should be, m, [E, N, 2]; None: the targets of the states.
            drifts: velocities of the targets, m/s, [E, N, 2]; None: they rest.

        Raises:
            SchemaError: `reset` was not called for an episode of the step.
        """
        if len(step.seeds) != len(self._seeds) or not (
            self._planned.all() and np.array_equal(self._seeds, step.seeds)
        ):
            raise SchemaError(
                "the scripted policy has no map of some episodes of this step. Call "
                "policy.reset(step, copies) whenever the environment resets copies."
            )
        states = robots_of(step.states, self._n_agents).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY, TX, TY, UX, UY]])
        if targets is not None:
            robots[..., 4:6] = targets
        drifts = self._no_drifts if drifts is None else np.ascontiguousarray(drifts, np.float64)
        commands = np.empty((len(robots), self._n_agents, 2))
        navigate(robots, drifts, self._team, self._half, self._maps, commands)
        return commands
