"""The controller a warehouse engineer would write: traffic rules, brakes, and a right of way.

Each robot, on its own, in each step:

1. steers at a point of its route (`warehouse_routes`), at full speed;
2. takes the velocity nearest to that which is safe (`orca`). Hard limits: it approaches surfaces
   and robots only so fast that it can still brake (`avoidance.BRAKE`). Soft limits: reciprocal
   avoidance, half and half;
3. gives way. Where tracks cross and where robots turn round, two robots that each avoid half can
   wait for each other for ever. So besides its half, a robot makes room for the velocity that a
   robot with a lower number wants, all by itself: of each pair one always gets its way.

The velocity becomes a command in `tracking`, so robots of every drive can be mixed.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import (
    BRAKE,
    SENSE,
    SURFACE_MARGIN,
    stopping_half_planes,
    surface_half_planes,
)
from swarmdata.behavior_policies.navigation.orca import damper_half_plane, robot_half_plane, solve
from swarmdata.behavior_policies.navigation.robot_scales import scales_of
from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.noise import check_noise
from swarmdata.behavior_policies.scripted import actions_of
from swarmdata.behavior_policies.warehouse.traffic_routes import steer, tracks_of
from swarmdata.envs.physics.dynamics import ACCELERATION, SPEED, UNICYCLE, limits_of
from swarmdata.envs.warehouse.floor_plan import FloorPlan
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

HORIZON = 0.8
"""Seconds for which robots avoid each other: 2 v / a of the default robot, so that it can brake.
Longer ones make robots wait that only pass each other."""

MARGIN = 0.05
"""Metres of gap kept between robots; the tracks of an aisle of 0.65 m leave 0.07."""


@kernel
def brake_half_planes(
    i: int, robots: Double, radii: Double, scales: Double, n: int, planes: Double
) -> int:
    """Writes the velocities with which robot i can still brake before every robot near it.

    What the other makes room for comes on top. Zero velocity is always among them, so these limits
    can be as hard as those of surfaces.

    Args:
        i: which robot.
        robots: columns x, y, vx, vy first, [N, any].
        radii: m, [N].
        scales: of time and length of every robot (`agility`), [N, 2].
        n: how many half-planes there are already.
        planes: written from row n.

    Returns:
        How many half-planes there are now.
    """
    for j in range(robots.shape[0]):
        time, length = max(scales[i, 0], scales[j, 0]), max(scales[i, 1], scales[j, 1])
        x, y, sense = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1], SENSE * length
        if j == i or x * x + y * y > sense * sense:
            continue
        d = max(math.sqrt(x * x + y * y), 1e-9)
        leaving = max((robots[j, 2] * x + robots[j, 3] * y) / d, 0.0)
        room = max(d - radii[i] - radii[j] - SURFACE_MARGIN, 0.0) / (BRAKE * time)
        damper_half_plane(x / d, y / d, room + leaving, planes[n])
        n += 1
    return n


@kernel
def rank_half_planes(
    i: int, robots: Double, radii: Double, scales: Double, aims: Double, n: int, planes: Double
) -> int:
    """Writes the velocities of robot i that are safe with the robots near it.

    Args:
        i: which robot.
        robots: columns x, y, vx, vy first, [N, any].
        radii: m, [N].
        scales: of time and length of every robot (`agility`), [N, 2].
        aims: preferred velocity of every robot, m/s, [N, 2].
        n: how many half-planes there are already.
        planes: written from row n.

    Returns:
        How many half-planes there are now.
    """
    own = (robots[i, 2], robots[i, 3])
    for j in range(robots.shape[0]):
        time, length = max(scales[i, 0], scales[j, 0]), max(scales[i, 1], scales[j, 1])
        x, y, sense = robots[j, 0] - robots[i, 0], robots[j, 1] - robots[i, 1], SENSE * length
        if j == i or x * x + y * y > sense * sense:
            continue
        reach = radii[i] + radii[j] + MARGIN
        velocity = (robots[j, 2], robots[j, 3])
        rule = (HORIZON * time, BRAKE * time, 0.5)
        robot_half_plane((x, y), own, velocity, reach, rule, planes[n])
        n += 1
        if j < i:
            wish = (aims[j, 0], aims[j, 1])
            rule = (HORIZON * time, BRAKE * time, 1.0)
            robot_half_plane((x, y), own, wish, reach, rule, planes[n])
            n += 1
    return n


@kernel
def act_copies(
    robots: Double,
    team: tuple[Double, Double, Double, Double, float],
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
        robots: x, y, vx, vy, target x and y, heading ux and uy, [E, N, 8].
        team: radius, m, and maximum speed, m/s, [N, 2]; rows of `dynamics.limits_of`, [N, 5];
            scales of time and length, [N, 2]; time to stop, s, [N]; control step, s.
        half: half width and half height of the arena, m, [2].
        layouts: shelves, [E, M, 8].
        lanes: of the plan, [L, 2].
        rows: of the plan, [3].
        middles: of the plan, [aisles + 1].
        tracks: see `steer`, [4].
        out: written, in [-1, 1], [E, N, 2].
    """
    bodies, limits, scales, brakes, dt = team
    radii, n_robots = bodies[:, 0], robots.shape[1]
    planes = np.empty((layouts.shape[1] + 4 + 4 * n_robots, 4))
    aims = np.empty((n_robots, 2))
    for b in range(robots.shape[0]):
        now = robots[b]
        for i in range(n_robots):
            x, y, target = now[i, 0], now[i, 1], (now[i, 4], now[i, 5])
            to_x, to_y = steer(x, y, target, lanes, rows, middles, tracks)
            d = max(math.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)), 1e-9)
            speed = bodies[i, 1] / d
            aims[i, 0], aims[i, 1] = (to_x - x) * speed, (to_y - y) * speed
        for i in range(n_robots):
            x, y, time, length = now[i, 0], now[i, 1], scales[i, 0], scales[i, 1]
            n = surface_half_planes(x, y, radii[i], layouts[b], half, planes, time, length)
            n_hard = brake_half_planes(i, now, radii, scales, n, planes)
            if limits[i, UNICYCLE] == 1.0:
                n_hard = stopping_half_planes(i, now, bodies, brakes, n_hard, planes)
            n = rank_half_planes(i, now, radii, scales, aims, n_hard, planes)
            wish = solve(planes, n, n_hard, bodies[i, 1], (aims[i, 0], aims[i, 1]))
            moving, heading = (now[i, 2], now[i, 3]), (now[i, 6], now[i, 7])
            command_of(moving, heading, wish, limits[i], planes, n, dt, out[b, i])


class WarehouseScript:
    """Routes and right of way on the floor plan.

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
        self._plan, self._noise = FloorPlan.of(spec), check_noise(noise)
        self._last = LastMeans()
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        bodies = np.array([(robot.radius, robot.max_speed) for robot in spec.robots])
        limits = limits_of(spec)
        brakes = limits[:, SPEED] / limits[:, ACCELERATION] + spec.control_dt
        self._team = (bodies, limits, scales_of(spec), brakes, spec.control_dt)
        self._tracks = tracks_of(spec)
        self._n_agents, self._action_size = spec.n_agents, spec.action_size

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy remembers nothing."""

    def act(self, step: Step) -> Float:
        commands = self._last.keep(step, self._commands(step))
        return actions_of(commands, step, self._noise, self._action_size)

    def log_probs(self, step: Step, actions: Float) -> Float:
        commands = self._last.recall(step)
        if commands is None:
            commands = self._commands(step)
        return noisy_log_probs(commands, actions, self._noise)

    def _commands(self, step: Step) -> Double:
        plan, states = self._plan, robots_of(step.states, self._n_agents).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY, TX, TY, UX, UY]])
        commands = np.empty((*robots.shape[:2], 2))
        act_copies(
            robots, self._team, self._half, step.layouts, plan.lanes, plan.rows, plan.middles,
            self._tracks, commands,
        )  # fmt: skip
        return commands
