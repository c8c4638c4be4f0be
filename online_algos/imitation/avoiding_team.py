"""AvoidingTeam, a teacher: a team whose commands are made safe by reciprocal avoidance.

A filter that knows the map and all velocities changes commands only shortly before a contact;
actors that clone the filtered team learn these corrections from labels. As in `scripted`, surfaces
are hard limits and robots soft ones, shared half and half; robots avoid each other later than
there.
"""

import math

import numpy as np

from swarmdata.behavior_policies.navigation.avoidance import robot_half_planes, surface_half_planes
from swarmdata.behavior_policies.navigation.episode_maps import n_primitives, primitives_of
from swarmdata.behavior_policies.navigation.orca import solve
from swarmdata.behavior_policies.navigation.robot_scales import LENGTH_SCALE, TIME_SCALE, Team
from swarmdata.envs.physics.dynamics import SPEED
from swarmdata.errors import SpecError
from swarmdata.interfaces import VecEnv
from swarmdata.online_algos.actors.mean_actors import Actors
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.imitation.teacher_cloning import Teacher
from swarmdata.registry.components import make_task
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.types import Double, Float, Int, Step

FILTER_HORIZON = 0.5
"""Seconds for which robots avoid each other; with more, those of `transport` block each other
beside the payload."""

FILTER_GAP = 0.04
"""Metres of gap kept between robots, more than in `avoidance`: clones are not exact."""

FILTERED_KIND = ("holonomic", "velocity")
"""Dynamics and command of the robots whose commands can be made safe."""

NO_RIGHT_OF_WAY = 1e9
"""Distance to the goal of every robot, m: none is near enough to it to give way."""


@kernel
def make_safe(
    all_robots: Double, team: Team, half: Double, primitives: Float, margin: float, out: Double
) -> None:
    """Replaces velocity commands, in [-1, 1], [E, N, 2], by the nearest safe ones, in `out`.

    `all_robots` are x, y, vx, vy, [E, N, 4], `half` half width and half height of the arena, m,
    [2], `primitives` obstacles as convex shapes, [E, P, 8]; `margin`, m, is kept from surfaces
    besides `avoidance.SURFACE_GAP`.
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
            x, y, radius = robots[i, 0], robots[i, 1], radii[i] + margin
            speed, time, length = limits[i, SPEED], scales[i, TIME_SCALE], scales[i, LENGTH_SCALE]
            n_hard = surface_half_planes(x, y, radius, primitives[b], half, planes, time, length)
            n = robot_half_planes(i, robots, radii, scales, aims, rule, n_hard, planes)
            wish = solve(planes, n, n_hard, speed, (aims[i, 0], aims[i, 1]))
            out[b, i, 0], out[b, i, 1] = wish[0] / speed, wish[1] / speed


class ActorTeam:
    """Implements `teacher_cloning.Teacher`: actors in all copies of their seeds."""

    def __init__(self, actors: Actors, worlds: Worlds) -> None:
        self._actors, self._worlds = actors, worlds

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: actors have no memory."""

    def act(self, step: Step) -> Float:
        """Returns the commands of all robots in the world's frame, [E, N, 2]."""
        inputs = self._actors.inputs(self._worlds.observations(step))
        return self._worlds.to_world(step, self._actors.means(inputs).numpy()).astype(np.float32)


class AvoidingTeam:
    """Implements `teacher_cloning.Teacher`: another teacher, kept from contacts.

    `margin` is the gap kept from surfaces besides `avoidance.SURFACE_GAP`, m.
    """

    def __init__(self, teacher: Teacher, env: VecEnv, margin: float) -> None:
        spec = env.spec
        kinds = {(robot.dynamics, robot.command) for robot in spec.robots}
        if kinds != {FILTERED_KIND}:
            found = ", ".join(" ".join(kind) for kind in sorted(kinds))
            raise SpecError(
                f"avoidance is for {' '.join(FILTERED_KIND)} commands, the robots of "
                f"{spec.task} have {found} commands; train without it"
            )
        self._teacher, self._team, self._margin = teacher, Team.of(spec), margin
        self._half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        obstacles = make_task(spec).kinds
        self._layouts = np.full((env.n_copies, len(obstacles), 8), np.nan, np.float32)
        shape = (env.n_copies, n_primitives(obstacles), 8)
        self._primitives: Float = np.zeros(shape, dtype=np.float32)

    def reset(self, step: Step, copies: Int) -> None:
        """Resets the teacher in `copies`, and takes over their obstacles where they are new."""
        self._teacher.reset(step, copies)
        for b in copies:
            if not np.array_equal(self._layouts[b], step.layouts[b]):
                self._layouts[b] = step.layouts[b]
                self._primitives[b] = primitives_of(step.layouts[b])

    def act(self, step: Step) -> Float:
        """Returns the safe commands of all robots in the world's frame, [E, N, 2]."""
        commands = self._teacher.act(step).astype(np.float64)
        states = robots_of(step.states, commands.shape[1]).astype(np.float64)
        robots = np.ascontiguousarray(states[..., [X, Y, VX, VY]])
        make_safe(robots, self._team, self._half, self._primitives, self._margin, commands)
        return commands.astype(np.float32)
