"""Cooperative navigation: N robots drive to their own goals among obstacles and each other.

State [S = 6 N], float32: per robot position (m), velocity (m/s) and goal position (m).
Action [A = 2]: a velocity command in units of the maximum speed (or an acceleration command, as the
spec says); its norm is clipped to 1.
Observation [O]: `sensing.state_observation_fields`.

Reward of robot i, with weights w from `spec.rewards`, d its distance to its goal before (d') and
after the step, and [x] one if x holds, else zero:

    w.progress (d' - d) - w.time [d > goal_radius] + w.success [all robots at their goals]
    - w.robot_contact [in contact with a robot]       - w.robot_collision * contacts that began
    - w.obstacle_contact [in contact with an obstacle] - w.obstacle_collision * contacts that began
    - w.proximity clip(1 - gap / 0.1 m, 0, 1)

then mixed with the team mean by `team_share`. Everything is computed from the float32 states and
the recorded events, so it can be recomputed from a dataset.

Success, a termination: all robots within `goal_radius` of their goals at the same time. Failure, a
termination: a collision, if `termination.on_collision` is "fail". Truncation: the horizon.
"""

import math

import numpy as np
from numba import njit

from swarmdata.envs.spawn import density, size_table, spawn, spawn_margins
from swarmdata.envs.world import World
from swarmdata.errors import SchemaError, SpawnError
from swarmdata.sensing import observe_states, state_observation_size
from swarmdata.spec import TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int, Seeds, Step, copy_step

PROXIMITY = 0.1
"""Gap (m) below which the proximity term begins."""

TERMS = (
    "progress",
    "success",
    "time",
    "robot_contact",
    "obstacle_contact",
    "robot_collision",
    "obstacle_collision",
    "proximity",
)
"""Reward terms, in the order of the columns of `reward_terms`."""


@njit(nogil=True, cache=True)
def reward_terms(
    before: Float, after: Float, events: Counts, gaps: Double, goal_radius: float, out: Double
) -> bool:
    """Writes the unweighted, signed reward terms of one copy; True if all are at their goals.

    Args:
        before: state before the step, [S].
        after: state after the step, [S].
        events: safety events of the step, [N, 4].
        gaps: smallest gap of each robot after the step, m, [N].
        goal_radius: m.
        out: written, [N, 8] columns `TERMS`.
    """
    n = gaps.shape[0]
    everyone = True
    for i in range(n):
        old_x, old_y = (
            float(before[6 * i + 4]) - float(before[6 * i]),
            float(before[6 * i + 5]) - float(before[6 * i + 1]),
        )
        new_x, new_y = (
            float(after[6 * i + 4]) - float(after[6 * i]),
            float(after[6 * i + 5]) - float(after[6 * i + 1]),
        )
        distance = math.sqrt(new_x * new_x + new_y * new_y)
        outside = distance > goal_radius
        everyone = everyone and not outside
        out[i, 0] = math.sqrt(old_x * old_x + old_y * old_y) - distance
        out[i, 2] = -1.0 if outside else 0.0
        for c in range(4):
            out[i, 3 + c] = -float(events[i, c])
        out[i, 7] = -min(max(1.0 - gaps[i] / PROXIMITY, 0.0), 1.0)
    for i in range(n):
        out[i, 1] = 1.0 if everyone else 0.0
    return everyone


@njit(nogil=True, cache=True)
def _combine(terms: Double, weights: Double, share: float, out: Float) -> None:
    """Weighs the terms of one copy and mixes them with the team mean, [N, 8] -> [N]."""
    n = terms.shape[0]
    total = 0.0
    for i in range(n):
        reward = 0.0
        for c in range(terms.shape[1]):
            reward += weights[c] * terms[i, c]
        terms[i, 0] = reward  # the terms are scratch from here on
        total += reward
    for i in range(n):
        out[i] = (1.0 - share) * terms[i, 0] + share * (total / n)


@njit(nogil=True, cache=True)
def score_steps(
    before: Float,
    after: Float,
    events: Counts,
    gaps: Double,
    active: Bool,
    rules: tuple[float, bool, int],
    weights: tuple[Double, float],
    times: Int,
    out: tuple[Float, Bool, Bool, Bool],
) -> None:
    """Writes rewards and ends of every active copy.

    Args:
        before: states before the step, [E, S].
        after: states after the step, [E, S].
        events: [E, N, 4].
        gaps: [E, N] m.
        active: [E].
        rules: goal radius, whether a collision fails the task, horizon.
        weights: per term [8], and the team share.
        times: control steps taken, this one included, [E].
        out: written: rewards [E, N], terminations [E], truncations [E], successes [E].
    """
    goal_radius, fail_on_collision, horizon = rules
    rewards, terminations, truncations, successes = out
    terms = np.empty((gaps.shape[1], len(TERMS)))
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        success = reward_terms(before[b], after[b], events[b], gaps[b], goal_radius, terms)
        _combine(terms, weights[0], weights[1], rewards[b])
        failure = fail_on_collision and (events[b, :, 2].any() or events[b, :, 3].any())
        successes[b] = success and not failure
        terminations[b] = success or failure
        truncations[b] = times[b] >= horizon and not terminations[b]


@njit(nogil=True, cache=True)
def _write_states(positions: Double, velocities: Double, active: Bool, states: Float) -> None:
    """Rounds the active copies' positions and velocities to float32 states; goals stay."""
    for b in range(states.shape[0]):
        if active[b]:
            for i in range(positions.shape[1]):
                states[b, 6 * i] = positions[b, i, 0]
                states[b, 6 * i + 1] = positions[b, i, 1]
                states[b, 6 * i + 2] = velocities[b, i, 0]
                states[b, 6 * i + 3] = velocities[b, i, 1]


class CoopNav:
    """E copies of cooperative navigation; implements `interfaces.VecEnv`.

    Args:
        spec: the task.
        n_copies: E.

    Raises:
        SpecError: the spec asks for what this version cannot run.
    """

    def __init__(self, spec: TaskSpec, n_copies: int = 1) -> None:
        self.spec, self.n_copies = spec, n_copies
        n, model = spec.n_agents, spec.observation
        self.action_size, self.state_size = 2, 6 * n
        self._slots = (model.n_neighbors, model.n_obstacles)
        self.observation_size = state_observation_size(*self._slots)
        self._world = World(spec, n_copies)
        self._sizes, self._margins = size_table(spec), spawn_margins(spec)
        self._weights = np.array([getattr(spec.rewards, term) for term in TERMS])
        self._starts: Float = np.zeros((n_copies, n, 2), dtype=np.float32)
        self._goals: Float = np.zeros((n_copies, n, 2), dtype=np.float32)
        self._gaps: Double = np.zeros((n_copies, n))
        self._now: Step | None = None

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts the episodes `seeds` in `copies`; see `interfaces.VecEnv.reset`."""
        chosen = np.arange(self.n_copies) if copies is None else np.asarray(copies, dtype=np.int64)
        seeds = np.asarray(seeds, dtype=np.uint64)
        if seeds.shape != chosen.shape:
            raise SchemaError(
                f"reset got seeds of shape {seeds.shape}, expected {chosen.shape}: "
                "one per reset copy"
            )
        if self._now is None and copies is not None and len(np.unique(chosen)) != self.n_copies:
            raise SchemaError(
                f"the first reset must reset all {self.n_copies} copies, got {len(chosen)}"
            )
        self._spawn(seeds, chosen)
        now = self._fresh()
        resets = np.zeros(self.n_copies, dtype=np.bool_)
        resets[chosen] = True
        now.states.reshape(self.n_copies, -1, 6)[chosen, :, 4:] = self._goals[chosen]
        now.seeds[chosen] = seeds
        now.layouts[chosen] = self._world.layouts[chosen]
        for array in (
            now.rewards,
            now.terminations,
            now.truncations,
            now.successes,
            now.events,
            now.times,
        ):
            array[chosen] = 0
        return self._observe(now, resets)

    def step(self, actions: Float | Double) -> Step:
        """Advances the copies that have not ended; see `interfaces.VecEnv.step`."""
        before = self._now
        if before is None:
            raise SchemaError("step was called before the first reset; call env.reset(seeds) first")
        actions = np.asarray(actions, dtype=np.float64)
        expected = (self.n_copies, self.spec.n_agents, self.action_size)
        if actions.shape != expected:
            raise SchemaError(f"actions have shape {actions.shape}, expected {expected} [E, N, A]")
        active = ~before.ended
        if not self._world.step(actions, active):
            raise SchemaError(
                "an action is NaN or infinite; actions must be finite numbers in [-1, 1]"
            )
        now = self._fresh()
        now.times[active] += 1
        now.rewards[~active] = 0
        now.events[:] = self._world.contacts.events
        now.events[~active] = 0
        self._observe(now, active)
        rules = (
            self.spec.termination.goal_radius,
            self.spec.termination.on_collision == "fail",
            self.spec.horizon,
        )
        score_steps(
            before.states, now.states, now.events, self._gaps, active, rules,
            (self._weights, self.spec.rewards.team_share), now.times,
            (now.rewards, now.terminations, now.truncations, now.successes),
        )  # fmt: skip
        return now

    def _spawn(self, seeds: Seeds, chosen: Int) -> None:
        drawn = spawn(
            seeds, chosen, self._sizes, self._world.half, self._world.radii, self._margins,
            self.spec.spawn.max_attempts, self._world.layouts, self._starts, self._goals,
        )  # fmt: skip
        if drawn < len(chosen):
            raise SpawnError(
                f"no layout found for seed {seeds[drawn]} in {self.spec.spawn.max_attempts} "
                f"attempts: robots and obstacles with their gaps cover {density(self.spec):.0%} "
                "of the arena (about 50% is the limit). Use fewer or smaller obstacles."
            )
        self._world.reset(chosen, self._starts.astype(np.float64))

    def _fresh(self) -> Step:
        """A step with copies of the present arrays, so that earlier steps stay as they were."""
        if self._now is not None:
            return copy_step(self._now)
        e, n = self.n_copies, self.spec.n_agents
        flags = [np.zeros(e, dtype=np.bool_) for _ in range(3)]
        return Step(
            observations=np.zeros((e, n, self.observation_size), dtype=np.float32),
            states=np.zeros((e, self.state_size), dtype=np.float32),
            rewards=np.zeros((e, n), dtype=np.float32),
            terminations=flags[0],
            truncations=flags[1],
            successes=flags[2],
            events=np.zeros((e, n, 4), dtype=np.uint8),
            seeds=np.zeros(e, dtype=np.uint64),
            times=np.zeros(e, dtype=np.int64),
            layouts=np.zeros_like(self._world.layouts),
        )

    def _observe(self, now: Step, active: Bool) -> Step:
        backend, world = self._world.backend, self._world
        _write_states(backend.positions, backend.velocities, active, now.states)
        observe_states(
            now.states, now.layouts, world.radii, world.half, self._slots,
            self.spec.observation.range, active, now.observations, self._gaps,
        )  # fmt: skip
        self._now = now
        return now
