"""AvoidingTeam, a teacher: trained teams whose commands are made safe by reciprocal avoidance.

A policy that was trained on rewards still brushes past robots and surfaces: contacts are rare, so
rewards say little about them. A filter that knows the map and all velocities changes commands only
shortly before a contact. Actors that clone the filtered team learn these corrections from labels.

As in `scripted`, surfaces are hard limits and robots soft ones, shared half and half. Robots avoid
each other later than there: the team has its own ways of passing, which should not change.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import robot_half_planes, surface_half_planes
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.primitives import n_primitives, primitives_of
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, Team
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.errors import SpecError
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.ppo.networks import Actors
from swarmdata.registry.components import make_task
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.types import Double, Float, Int, Step

FILTER_HORIZON = 0.5
"""Seconds for which robots avoid each other. With 0.8 s, robots of `transport` block each other
beside the payload: a filtered expert solves 77 % of 384 episodes instead of 92."""

FILTER_GAP = 0.04
"""Metres of gap kept between robots, more than in `avoidance`: clones are not exact."""

SURFACE_MARGIN = 0.02
"""Metres of gap kept from surfaces besides `avoidance.SURFACE_GAP`, for the same reason."""

FILTERED_KIND = ("holonomic", "velocity")
"""Dynamics and command of the robots whose commands can be made safe."""

NO_RIGHT_OF_WAY = 1e9
"""Distance to the goal of every robot, m: none is near enough to it to give way."""


@kernel
def make_safe(all_robots: Double, team: Team, half: Double, primitives: Float, out: Double) -> None:
    """Replaces velocity commands by the nearest safe ones.

    Args:
        all_robots: x, y, vx, vy of the robots of all copies, [E, N, 4].
        team: constants of the robots.
        half: half width and half height of the arena, m, [2].
        primitives: obstacles as convex shapes, [E, P, 8].
        out: commands, in [-1, 1], replaced, [E, N, 2].
    """
    radii, limits, scales, _, _ = team
    n_robots, rule = all_robots.shape[1], (FILTER_HORIZON, FILTER_GAP)
    planes = np.empty((primitives.shape[1] + 4 + 2 * n_robots, 4))
    aims = np.empty((n_robots, 3))
    for b in range(all_robots.shape[0]):
        robots = all_robots[b]
        for i in range(n_robots):
            x, y = out[b, i, 0], out[b, i, 1]
            speed = limits[i, SPEED] / max(math.sqrt(x * x + y * y), 1.0)
            aims[i, 0], aims[i, 1], aims[i, 2] = x * speed, y * speed, NO_RIGHT_OF_WAY
        for i in range(n_robots):
            x, y, radius = robots[i, 0], robots[i, 1], radii[i] + SURFACE_MARGIN
            speed, time, length = limits[i, SPEED], scales[i, TIME_SCALE], scales[i, LENGTH_SCALE]
            n_hard = surface_half_planes(x, y, radius, primitives[b], half, planes, time, length)
            n = robot_half_planes(i, robots, radii, scales, aims, rule, n_hard, planes)
            wish = solve(planes, n, n_hard, speed, (aims[i, 0], aims[i, 1]))
            out[b, i, 0], out[b, i, 1] = wish[0] / speed, wish[1] / speed


class AvoidingTeam:
    """Implements `teacher_cloning.Teacher` for all copies of some worlds.

    Args:
        actors: of the worlds' seeds; they choose the commands that are made safe.
        worlds: to act in.

    Raises:
        SpecError: the robots' commands are not velocities in the world's axes.
    """

    def __init__(self, actors: Actors, worlds: Worlds) -> None:
        spec = worlds.env.spec
        kinds = {(robot.dynamics, robot.command) for robot in spec.robots}
        if kinds != {FILTERED_KIND}:
            found = ", ".join(" ".join(kind) for kind in sorted(kinds))
            raise SpecError(
                f"start.avoidance is for {' '.join(FILTERED_KIND)} commands, the robots of "
                f"{spec.task} have {found} commands; train without it"
            )
        self._actors, self._worlds, self._team = actors, worlds, Team.of(spec)
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        shape = (worlds.env.n_copies, n_primitives(make_task(spec).kinds), 8)
        self._primitives: Float = np.zeros(shape, dtype=np.float32)

    def reset(self, step: Step, copies: Int) -> None:
        """Takes over the obstacles of `copies`; of the rest, the teacher has no memory."""
        for b in copies:
            self._primitives[b] = primitives_of(step.layouts[b])

    def act(self, step: Step) -> Float:
        """Returns the safe commands of all robots in the world's frame, [E, N, 2]."""
        inputs = self._actors.inputs(self._worlds.observations(step))
        commands = self._worlds.to_world(step, self._actors.means(inputs).numpy())
        states = robots_of(step.states, commands.shape[1]).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY]])
        make_safe(robots, self._team, self._half, self._primitives, commands)
        return commands.astype(np.float32)
