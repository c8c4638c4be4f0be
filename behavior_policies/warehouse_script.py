"""The controller a warehouse engineer would write: traffic rules, brakes, and a right of way.

Each robot, on its own, in each step:

1. steers at a point of its route (`warehouse_routes`), at full speed;
2. takes the velocity nearest to that which is safe (`orca`). Hard limits: it approaches surfaces
   and robots only so fast that it can still brake (`avoidance.BRAKE`). Soft limits: reciprocal
   avoidance, half and half;
3. gives way. Where tracks cross and where robots turn round, two robots that each avoid half can
   wait for each other for ever. So besides its half, a robot makes room for the velocity that a
   robot with a lower number wants, all by itself: of each pair one always gets its way.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np
from numba import njit

from swarmdata.behavior_policies.avoidance import (
    BRAKE,
    SENSE,
    SURFACE_MARGIN,
    surface_half_planes,
)
from swarmdata.behavior_policies.noise import add_noise, check_noise
from swarmdata.behavior_policies.orca import damper_half_plane, robot_half_plane, solve
from swarmdata.behavior_policies.warehouse_routes import steer, tracks_of
from swarmdata.envs.floor_plan import FloorPlan
from swarmdata.errors import SpecError
from swarmdata.spec import TaskSpec
from swarmdata.states import TX, TY, VX, VY, X, Y, robots_of
from swarmdata.types import Double, Float, Int, Step

HORIZON = 0.8
"""Seconds for which robots avoid each other: 2 v / a of the default robot, so that it can brake.
Longer ones make robots wait that only pass each other."""

MARGIN = 0.05
"""Metres of gap kept between robots; the tracks of an aisle of 0.65 m leave 0.07."""


@njit(nogil=True, cache=True)
def brake_half_planes(i: int, robots: Double, radii: Double, n: int, planes: Double) -> int:
    """Writes the velocities with which robot i can still brake before every robot near it.

    What the other makes room for comes on top. Zero velocity is always among them, so these limits
    can be as hard as those of surfaces.

    Args:
        i: which robot.
        robots: columns x, y, vx, vy first, [N, any].
        radii: m, [N].
        n: how many half-planes there are already.
        planes: written from row n.

    Returns:
        How many half-planes there are now.
    """
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        if j == i or x * x + y * y > SENSE * SENSE:
            continue
        d = max(math.sqrt(x * x + y * y), 1e-9)
        leaving = max((robots[j, 2] * x + robots[j, 3] * y) / d, 0.0)
        room = max(d - radii[i] - radii[j] - SURFACE_MARGIN, 0.0) / BRAKE
        damper_half_plane(x / d, y / d, room + leaving, planes[n])
        n += 1
    return n


@njit(nogil=True, cache=True)
def rank_half_planes(
    i: int, robots: Double, radii: Double, aims: Double, n: int, planes: Double
) -> int:
    """Writes the velocities of robot i that are safe with the robots near it.

    Args:
        i: which robot.
        robots: columns x, y, vx, vy first, [N, any].
        radii: m, [N].
        aims: preferred velocity of every robot, m/s, [N, 2].
        n: how many half-planes there are already.
        planes: written from row n.

    Returns:
        How many half-planes there are now.
    """
    own = (robots[i, 2], robots[i, 3])
    for j in range(robots.shape[0]):
        x, y = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1]
        if j == i or x * x + y * y > SENSE * SENSE:
            continue
        reach = radii[i] + radii[j] + MARGIN
        velocity = (robots[j, 2], robots[j, 3])
        robot_half_plane((x, y), own, velocity, reach, (HORIZON, BRAKE, 0.5), planes[n])
        n += 1
        if j < i:
            wish = (aims[j, 0], aims[j, 1])
            robot_half_plane((x, y), own, wish, reach, (HORIZON, BRAKE, 1.0), planes[n])
            n += 1
    return n


@njit(nogil=True, cache=True)
def act_copies(
    robots: Double,
    limits: Double,
    half: Double,
    layouts: Float,
    lanes: Double,
    rows: Double,
    middles: Double,
    tracks: Double,
    out: Double,
) -> None:
    """Writes the commands of all robots of all copies.

    Args:
        robots: columns x, y, vx, vy, tx, ty, [E, N, 6].
        limits: radius, m, and maximum speed, m/s, [N, 2].
        half: half width and half height of the arena, m, [2].
        layouts: shelves, [E, M, 8].
        lanes: of the plan, [L, 2].
        rows: of the plan, [3].
        middles: of the plan, [aisles + 1].
        tracks: see `steer`, [4].
        out: written, velocity / maximum speed, [E, N, 2].
    """
    n_robots = robots.shape[1]
    planes = np.empty((layouts.shape[1] + 4 + 3 * n_robots, 4))
    aims = np.empty((n_robots, 2))
    for b in range(robots.shape[0]):
        now = robots[b]
        for i in range(n_robots):
            x, y, target = now[i, 0], now[i, 1], (now[i, 4], now[i, 5])
            to_x, to_y = steer(x, y, target, lanes, rows, middles, tracks)
            d = max(math.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)), 1e-9)
            speed = limits[i, 1] / d
            aims[i, 0], aims[i, 1] = (to_x - x) * speed, (to_y - y) * speed
        for i in range(n_robots):
            x, y, radius = now[i, 0], now[i, 1], limits[i, 0]
            n_hard = surface_half_planes(x, y, radius, layouts[b], half, planes)
            n_hard = brake_half_planes(i, now, limits[:, 0], n_hard, planes)
            n = rank_half_planes(i, now, limits[:, 0], aims, n_hard, planes)
            vx, vy = solve(planes, n, n_hard, limits[i, 1], (aims[i, 0], aims[i, 1]))
            out[b, i, 0], out[b, i, 1] = vx / limits[i, 1], vy / limits[i, 1]


class WarehouseScript:
    """Routes and right of way on the floor plan, for holonomic robots.

    It knows the floor plan, and the positions, velocities and targets of all robots
    (`step.states`).

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: a robot is not holonomic or not driven by velocity commands, `noise` is not a
            standard deviation, or the spec is another task's.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        for name, robot in zip(spec.agent_names, spec.robots, strict=True):
            if (robot.dynamics, robot.command) != ("holonomic", "velocity"):
                raise SpecError(
                    f"{name} has {robot.dynamics} dynamics with {robot.command} commands; the "
                    "scripted policy drives holonomic robots by velocity commands."
                )
        self._plan, self._noise = FloorPlan.of(spec), check_noise(noise)
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self._limits = np.array([[robot.radius, robot.max_speed] for robot in spec.robots])
        self._tracks = tracks_of(spec)
        self._shape = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        plan, robots = self._plan, robots_of(step.states, self._shape[0]).astype(np.float64)
        commands = np.empty((*robots.shape[:2], 2))
        act_copies(
            np.ascontiguousarray(robots[..., [X, Y, VX, VY, TX, TY]]), self._limits, self._half,
            step.layouts, plan.lanes, plan.rows, plan.middles, self._tracks, commands,
        )  # fmt: skip
        actions = np.zeros((len(robots), *self._shape), dtype=np.float32)
        actions[..., :2] = add_noise(commands, step, self._noise)
        return actions
