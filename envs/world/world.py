"""The world of a task: commanded robots, the bodies that they push, and their contacts."""

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np

from swarmdata.envs.physics.backend import Backend, Contacts, Moving, Plan
from swarmdata.envs.physics.dynamics import Motors, begin_step, limits_of
from swarmdata.envs.physics.episode_bodies import episode_limits, episode_payloads, payload_rows
from swarmdata.envs.physics.fast_backend import FastBackend, integrates_exactly
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.physics.munk_calls import load_addresses
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.numerics.geometry import nearest_of, outer_radius, wall_gap
from swarmdata.numerics.weighted_terms import weigh_terms
from swarmdata.runtime.argument_blocks import bundle_type, unpack
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.types import PROXIMITY_RANGE, Bool, Counts, Double, Float, Int, Seeds, Step

N_SHARED_TERMS = 6  # terms of the reward that all tasks share: the last columns of `reward_terms`

_WIDER_RANGE = np.float32(PROXIMITY_RANGE + 1e-3)
"""For a first, cheap test in float32; wider, so that rounding never makes it too narrow."""

MakeBackend = Callable[[Plan, int], Backend]


def make_backend(plan: Plan, n_copies: int) -> Backend:
    """Returns the backend of the plan's spec.

    That of Pymunk is the fast one; where Munk2D's functions cannot be called, or its arithmetic is
    not that of `move`, the public one.

    Raises:
        MissingExtraError: the spec asks for MuJoCo, which is not installed.
    """
    if plan.spec.backend == "kinematic":
        return KinematicBackend(plan, n_copies)
    if plan.spec.backend == "mujoco":
        require_extra("mujoco", "mujoco", "simulating a world with backend mujoco")
        from swarmdata.envs.physics.mujoco_backend import MujocoBackend  # noqa: PLC0415  (an extra)

        return MujocoBackend(plan, n_copies)
    calls = load_addresses()
    if calls is None or not integrates_exactly():
        return PublicBackend(plan, n_copies)
    return FastBackend(plan, n_copies, calls)


@kernel(error_model="numpy")
def _robot_gaps(places: Float, radii: Double, gaps: Double) -> None:
    """Lowers gaps to those between robots, exact below `PROXIMITY_RANGE`."""
    n = radii.shape[0]
    for i in range(n):
        px, py, near = places[0, i], places[1, i], places[2, i] + _WIDER_RANGE
        is_near = False
        for j in range(i + 1, n):  # in vector registers
            dx, dy, reach = places[0, j] - px, places[1, j] - py, places[2, j] + near
            is_near |= dx * dx + dy * dy < reach * reach
        for j in range(i + 1, n if is_near else 0):
            dx, dy = places[0, j] - px, places[1, j] - py
            gap = math.sqrt(dx * dx + dy * dy) - radii[i] - radii[j]
            gaps[i], gaps[j] = min(gaps[i], gap), min(gaps[j], gap)


@kernel(error_model="numpy")
def _near_static_gap(px: float, py: float, radius: float, layout: Float, half: Double) -> float:
    """Gap of a robot to the nearest obstacle or wall, exact only below `PROXIMITY_RANGE`."""
    near, gap = np.float32(radius) + _WIDER_RANGE, math.inf
    for wall in range(4):
        gap = min(gap, wall_gap(px, py, half, wall) - radius)
    for m in range(layout.shape[0]):
        dx, dy = layout[m, 1] - px, layout[m, 2] - py
        reach = np.float32(outer_radius(layout[m])) + near
        if dx * dx + dy * dy < reach * reach:
            gap = min(gap, nearest_of(px, py, layout, m)[0] - radius)
    return gap


@kernel(error_model="numpy")
def proximities(
    state: Float,  # [S]
    layout: Float,  # [M, 8]
    radii: Double,  # [N] m
    half: Double,  # [2] half width and half height of the arena, m
    slack: Double,  # [N, 3] `backend.Contacts.slack` of this copy
    places: Float,  # [3, N] scratch: positions and radii
    out: Double,  # [N] written
) -> None:
    """Writes the proximity of each robot in one copy: 0 far from everything, 1 in contact.

    This is clip(1 - gap / PROXIMITY_RANGE, 0, 1) of the smallest gap to a robot, obstacle or wall;
    to these only where the slack does not tell that they are far.
    """
    for i in range(radii.shape[0]):
        px, py = state[N_COLUMNS * i], state[N_COLUMNS * i + 1]
        places[0, i], places[1, i], places[2, i] = px, py, radii[i]
        moved = abs(px - slack[i, 0]) + abs(py - slack[i, 1])
        out[i] = math.inf
        if slack[i, 2] - moved < _WIDER_RANGE:
            out[i] = _near_static_gap(px, py, radii[i], layout, half)
    _robot_gaps(places, radii, out)
    for i in range(radii.shape[0]):
        out[i] = min(max(1.0 - out[i] / PROXIMITY_RANGE, 0.0), 1.0)


class Scoring(NamedTuple):
    """What `score_steps` reads besides the step."""

    radii: Annotated[Double, 1]  # [N] m
    half: Annotated[Double, 1]  # [2] half width and half height of the arena, m
    weights: Annotated[Double, 1]  # [R] of all terms, with their signs
    team_share: float  # part of each reward that is the mean over the side
    bounds: Annotated[Int, 1]  # of the sides, `TaskSpec.side_bounds`
    is_fatal: bool  # whether a collision fails the task
    horizon: int  # steps
    solved: Annotated[Bool, 1]  # [E] whether the task is solved
    slack: Annotated[Double, 3]  # [E, N, 3] `backend.Contacts.slack`
    active: Annotated[Bool, 1]  # [E]


SCORING = bundle_type(Scoring)


@kernel
def score_steps(
    packed: Int,  # `Scoring`, of an `ArgumentBlock`
    states: Float,  # [E, S] after the step
    layouts: Float,  # [E, M, 8]
    events: Counts,  # [E, N, 4] of the step
    times: Int,  # [E] control steps taken, this one included
    terms: Float,  # [E, N, R] the task's own are read, the last six written
    rewards: Float,  # [E, N] written
    terminations: Bool,  # [E] written
    truncations: Bool,  # [E] written
    successes: Bool,  # [E] written
) -> None:
    """Writes the shared terms and the rewards of the active copies, and decides whether they end.

    The last six terms are `rewards.reward_terms`. The terms and rewards of the other copies are 0,
    and their flags stay.
    """
    radii, half, weights, team_share, bounds, is_fatal, horizon, solved, slack, active = unpack(
        packed, SCORING
    )
    n, first = radii.shape[0], weights.shape[0] - N_SHARED_TERMS
    near, places = np.empty(n), np.empty((3, n), np.float32)
    for b in range(states.shape[0]):
        if not active[b]:
            rewards[b] = 0.0
            terms[b] = 0.0
            continue
        proximities(states[b], layouts[b], radii, half, slack[b], places, near)
        is_solved, touched = solved[b], False
        is_held = times[b] >= horizon and not is_solved  # the other sides have succeeded
        for i in range(n):
            terms[b, i, first] = 1.0 if (is_solved if i < bounds[1] else is_held) else 0.0
            for c in range(4):
                terms[b, i, first + 1 + c] = events[b, i, c]
            terms[b, i, first + 5] = near[i]
            touched = touched or events[b, i, 2] > 0 or events[b, i, 3] > 0
        weigh_terms(terms[b], weights, team_share, bounds, near, rewards[b])
        failure = is_fatal and touched
        successes[b] = is_solved and not failure
        terminations[b] = is_solved or failure
        truncations[b] = times[b] >= horizon and not terminations[b]


@kernel
def begin_worlds(
    copies: Int,  # [C] rows
    states: Float,  # [E, S]
    touching: Bool,  # [E, N, N] cleared
    static: Bool,  # [E, N, M + 4] cleared
    slack: Double,  # [E, N, 3] cleared
    robots: Double,  # [C, N, 6] written
    bodies: Double,  # [C, K, 7] written
) -> None:
    """Ends the contacts of some copies, and reads what moves in them from their states."""
    first = N_COLUMNS * robots.shape[1]
    for row in range(copies.shape[0]):
        b = copies[row]
        touching[b], static[b], slack[b] = False, False, 0.0
        for i in range(robots.shape[1]):
            for c in range(6):
                robots[row, i, c] = states[b, N_COLUMNS * i + c]
        for k in range(bodies.shape[1]):
            for c in range(7):
                bodies[row, k, c] = states[b, first + 7 * k + c]


class World:
    """E copies of robots among obstacles, independent of any task.

    `active` marks the copies that took the last step, [E]; `contacts` are those of the robots.
    """

    def __init__(self, plan: Plan, n_copies: int, backend: MakeBackend = make_backend) -> None:
        spec, n, m = plan.spec, plan.spec.n_agents, len(plan.kinds)
        self.radii: Double = np.array([robot.radius for robot in spec.robots])
        self.half: Double = np.array(spec.half_size)
        self.active: Bool = np.zeros(n_copies, dtype=np.bool_)
        self.contacts = Contacts(
            robots=np.zeros((n_copies, n, n), dtype=np.bool_),
            obstacles=np.zeros((n_copies, n, m + 4), dtype=np.bool_),
            slack=np.zeros((n_copies, n, 3)),
        )
        self._backend = backend(plan, n_copies)
        self._commands: Double = np.zeros((n_copies, n, 2))
        self._motors = Motors.of(spec, n_copies)
        limits = limits_of(spec)
        self._spec, self._is_random = spec, bool(spec.randomization.ranges)
        self._movables, self._payloads = plan.movables, payload_rows(plan.movables)
        self._fixed = (limits, self.active, self._commands)

    def reset(self, copies: Int, seeds: Seeds, layouts: Float, states: Float) -> None:
        """Starts worlds at rest in `copies`, [C], of the episodes `seeds`, [C].

        `layouts` [E, M, 8] and `states` [E, S] are those of all copies.
        """
        n, k = len(self.radii), len(self._movables)
        robots: Double = np.empty((len(copies), n, 6))
        bodies: Double = np.empty((len(copies), k, 7))
        begin_worlds(copies, states, *self.contacts, robots, bodies)
        limits, payloads = self._fixed[0], self._payloads
        if self._is_random:
            limits = episode_limits(self._spec, seeds)
            payloads = episode_payloads(self._spec, self._movables, seeds)
        self._backend.reset(copies, layouts, Moving(robots, bodies, limits, payloads))
        if self._motors is not None:
            self._motors.reset(copies, seeds)

    def begin(self, actions: Float | Double, before: Step, now: Step) -> int:
        """Finds the copies that have not ended, and clips their commands.

        Times, events and states of `now` are written, as far as they are known. `actions` are
        [E, N, A], `before` is the previous step.

        Returns:
            The number of copies that had not ended; -1 if an action of one of them is not finite.
        """
        return begin_step(
            *self._fixed, actions, before.terminations, before.truncations, before.times,
            before.states, now.times, now.states, now.events,
        )  # fmt: skip

    def advance(self, now: Step) -> None:
        """Advances the copies that `begin` has found; writes the events and states of this step."""
        if self._motors is not None:
            self._motors.follow(self.active, now.times, self._commands)
        self._backend.step(self.active, self._commands, self.contacts, now.events, now.states)
