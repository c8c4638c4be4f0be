"""The world that tasks run in: robots under commands, what they push, and their contacts."""

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from swarmdata.envs.backend import Backend, Contacts, Plan
from swarmdata.envs.dynamics import clip_commands, limits_of
from swarmdata.envs.munk import MunkBackend, load_addresses
from swarmdata.envs.pymunk_space import PublicBackend
from swarmdata.geometry import bounding_radius, nearest, wall_gap
from swarmdata.states import N_COLUMNS
from swarmdata.types import Bool, Counts, Double, Float, Int

PROXIMITY = 0.1
"""Gap (m) to a robot, obstacle or wall below which proximity is above 0."""

MakeBackend = Callable[[Plan, int], Backend]


def make_backend(plan: Plan, n_copies: int) -> Backend:
    """Returns the fast backend, or the public one where Pymunk's private names are missing."""
    calls = load_addresses()
    return PublicBackend(plan, n_copies) if calls is None else MunkBackend(plan, n_copies, calls)


@njit(nogil=True, cache=True)
def _write_states(robots: Double, bodies: Double, active: Bool, states: Float) -> None:
    """Rounds the active copies' robots (but their targets) and bodies to float32 states."""
    first = N_COLUMNS * robots.shape[1]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        for i in range(robots.shape[1]):
            for c in range(6):
                states[b, N_COLUMNS * i + c] = robots[b, i, c]
        for k in range(bodies.shape[1]):
            for c in range(7):
                states[b, first + 7 * k + c] = bodies[b, k, c]


@njit(nogil=True, cache=True)
def _static_gap(px: float, py: float, radius: float, layout: Float, half: Double) -> float:
    """Gap of a robot to the nearest obstacle or wall, exact below `PROXIMITY`, else larger."""
    gap = math.inf
    for wall in range(4):
        gap = min(gap, wall_gap(px, py, half, wall) - radius)
    for m in range(layout.shape[0]):
        dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
        reach = bounding_radius(layout[m]) + radius + PROXIMITY
        if dx * dx + dy * dy < reach * reach:
            gap = min(gap, nearest(px, py, layout[m])[0] - radius)
    return gap


@njit(nogil=True, cache=True)
def proximities(state: Float, layout: Float, radii: Double, half: Double, out: Double) -> None:
    """Writes how near each robot of one copy is to touching something: 0 far, 1 at contact.

    clip(1 - gap / PROXIMITY, 0, 1), where the gap is the smallest to a robot, obstacle or wall.

    Args:
        state: [S].
        layout: [M, 8].
        radii: m, [N].
        half: half width and half height of the arena, m, [2].
        out: written, [N].
    """
    n = radii.shape[0]
    for i in range(n):
        px, py = float(state[N_COLUMNS * i]), float(state[N_COLUMNS * i + 1])
        out[i] = _static_gap(px, py, radii[i], layout, half)
    for i in range(n):
        for j in range(i + 1, n):
            dx = float(state[N_COLUMNS * j]) - float(state[N_COLUMNS * i])
            dy = float(state[N_COLUMNS * j + 1]) - float(state[N_COLUMNS * i + 1])
            reach = radii[i] + radii[j] + PROXIMITY
            square = dx * dx + dy * dy
            if square < reach * reach:
                gap = math.sqrt(square) - radii[i] - radii[j]
                out[i], out[j] = min(out[i], gap), min(out[j], gap)
    for i in range(n):
        out[i] = min(max(1.0 - out[i] / PROXIMITY, 0.0), 1.0)


@njit(nogil=True, cache=True)
def score_steps(
    states: Float,
    layouts: Float,
    body: tuple[Double, Double],
    events: Counts,
    active: Bool,
    task: tuple[Double, Bool],
    rules: tuple[bool, int],
    weights: Double,
    times: Int,
    out: tuple[Float, Bool, Bool, Bool],
) -> None:
    """Adds what every task shares to the rewards of the active copies, and decides their ends.

    Args:
        states: after the step, [E, S].
        layouts: [E, M, 8].
        body: radii, m, [N]; half width and half height of the arena, m, [2].
        events: of the step, [E, N, 4].
        active: [E].
        task: the task's own rewards [E, N], and whether it is solved [E].
        rules: whether a collision fails the task; horizon.
        weights: of the contact terms in the order of `events`, of proximity, of success, and the
            team's share, [7].
        times: control steps taken, this one included, [E].
        out: written: rewards [E, N], terminations, truncations and successes, each [E].
    """
    rewards, terminations, truncations, successes = out
    n = body[0].shape[0]
    near = np.empty(n)
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        proximities(states[b], layouts[b], body[0], body[1], near)
        solved, touched, mean = task[1][b], False, 0.0
        for i in range(n):
            reward = task[0][b, i] - weights[4] * near[i] + (weights[5] if solved else 0.0)
            for c in range(4):
                reward -= weights[c] * float(events[b, i, c])
            touched = touched or events[b, i, 2] > 0 or events[b, i, 3] > 0
            near[i] = reward
            mean += reward / n
        for i in range(n):
            rewards[b, i] = (1.0 - weights[6]) * near[i] + weights[6] * mean
        failure = rules[0] and touched
        successes[b] = solved and not failure
        terminations[b] = solved or failure
        truncations[b] = times[b] >= rules[1] and not terminations[b]


class World:
    """E copies of robots among obstacles; knows no task.

    `contacts.events` holds the events of the last step of each copy.
    """

    def __init__(self, plan: Plan, n_copies: int, backend: MakeBackend = make_backend) -> None:
        spec, n, m = plan.spec, plan.spec.n_agents, len(plan.kinds)
        self.body = (
            np.array([robot.radius for robot in spec.robots]),
            np.array([spec.arena.width / 2, spec.arena.height / 2]),
        )
        self.contacts = Contacts(
            robots=np.zeros((n_copies, n, n), dtype=np.bool_),
            obstacles=np.zeros((n_copies, n, m + 4), dtype=np.bool_),
            slack=np.zeros((n_copies, n, 3)),
            events=np.zeros((n_copies, n, 4), dtype=np.uint8),
        )
        self.backend = backend(plan, n_copies)
        self._limits = limits_of(spec)
        self._commands: Double = np.zeros((n_copies, n, 2))

    def reset(self, copies: Int, layouts: Float, states: Float) -> None:
        """Starts worlds in `copies` from layouts [E, M, 8] and states [E, S]; all are at rest."""
        e, n, _ = self.backend.robots.shape
        for array in self.contacts:
            array[copies] = 0
        robots = states[:, : N_COLUMNS * n].reshape(e, n, N_COLUMNS)[..., :6].astype(np.float64)
        k = self.backend.bodies.shape[1]
        bodies = states[:, N_COLUMNS * n : N_COLUMNS * n + 7 * k].reshape(e, k, 7)
        self.backend.reset(copies, layouts, robots, bodies.astype(np.float64))

    def step(self, actions: Float | Double, active: Bool, states: Float) -> bool:
        """Advances the active copies by one control step and writes their states.

        Returns:
            False, and nothing has happened, if an action is not finite.
        """
        if not clip_commands(actions, self._limits, active, self._commands):
            return False
        self.backend.step(active, self._commands, self.contacts)
        _write_states(self.backend.robots, self.backend.bodies, active, states)
        return True
