"""The step of avoidance that controllers share whose robots keep to lanes and tracks.

Hard limits: a robot approaches surfaces and robots only so fast that it can still brake. Soft
limits: reciprocal avoidance, half and half, and all the room for those with the right of way.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import (
    brake_half_planes,
    robot_half_planes,
    stopping_half_planes,
    surface_half_planes,
)
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, Team
from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.noise import Controller
from swarmdata.envs.physics.dynamics import SPEED, UNICYCLE
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Step

TRAFFIC_HORIZON = 0.8
"""Seconds for which robots avoid each other: 2 v / a of the default robot, so that it can brake.
With longer horizons, robots that only pass each other would wait."""

TRAFFIC_ROBOT_GAP = 0.05
"""Metres of gap kept between robots; the tracks of an aisle of 0.65 m leave 0.07, the lanes of an
arm of 0.7 m leave 0.11."""


@kernel
def drive_in_traffic(
    robots: Double, aims: Double, team: Team, half: Double, layout: Float, out: Double
) -> None:
    """Writes the commands of all robots of one copy, in [-1, 1], [N, 2].

    `robots`: x, y, vx, vy, target x and y, heading ux and uy first, [N, C]. `aims`: [N, 3] as of
    `robot_half_planes`, with anything that decides who gives way. `layout`: convex obstacles,
    [M, 8].
    """
    radii, limits, scales, _, dt = team
    n_robots, rule = robots.shape[0], (TRAFFIC_HORIZON, TRAFFIC_ROBOT_GAP)
    planes = np.empty((layout.shape[0] + 4 + 4 * n_robots, 4))
    for i in range(n_robots):
        x, y = robots[i, 0], robots[i, 1]
        time, length = scales[i, TIME_SCALE], scales[i, LENGTH_SCALE]
        n = surface_half_planes(x, y, radii[i], layout, half, planes, time, length)
        n_hard = brake_half_planes(i, robots, radii, scales, n, planes)
        if limits[i, UNICYCLE] == 1.0:
            n_hard = stopping_half_planes(i, robots, team, n_hard, planes)
        n = robot_half_planes(i, robots, radii, scales, aims, rule, n_hard, planes)
        wish = solve(planes, n, n_hard, limits[i, SPEED], (aims[i, 0], aims[i, 1]))
        velocity, heading = (robots[i, 2], robots[i, 3]), (robots[i, 6], robots[i, 7])
        command_of(velocity, heading, wish, limits[i], planes, n, dt, out[i])


class TrafficController(Controller):
    """A policy without memory whose robots keep to the lanes and tracks of their task.

    It knows the floor, and the positions, velocities and targets of all robots (`step.states`).
    `act_copies` is the task's kernel, which writes the commands of all copies, `rules` its
    argument. `noise` that is not a standard deviation raises a `SpecError`.
    """

    has_memory = False

    def __init__(
        self, spec: TaskSpec, noise: float, act_copies: Callable[..., None], rules: Any
    ) -> None:
        super().__init__(spec, noise)
        self._act_copies, self._rules = act_copies, rules
        self._team, self._n_agents = Team.of(spec), spec.n_agents
        self._half = np.array(spec.half_size)

    def _robots(self, states: Float) -> Double:
        """What the kernel reads of each robot, [E, N, C]."""
        robots = robots_of(states, self._n_agents)[..., [X, Y, VX, VY, TX, TY, UX, UY]]
        return robots.astype(np.float64)

    def commands(self, step: Step) -> Double:
        robots = np.ascontiguousarray(self._robots(step.states))
        commands: Double = np.empty((*robots.shape[:2], 2))
        self._act_copies(robots, self._team, self._half, step.layouts, self._rules, commands)
        return commands
