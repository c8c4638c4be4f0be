"""Pursuit: N robots capture evaders that are faster than they are, which takes several at a time.

Robots start at rest in one corner, evaders away from them. Evaders are moved by the task, by the
rule `rules.evader` (`evader`); they are no bodies of the physics. An evader is captured when at
least `captors` robots are within `capture_radius` of it after the same control step. From then on
it stays where it is.

With a `sight_range`, a robot sees an evader only within it and where no obstacle is between them.
It remembers where it saw it last for 5 s (`sightings`). Nobody else tells a robot of an evader:
what the others know, it learns from messages.

A robot's target is the nearest free evader that it knows, where it saw it last. If there is none,
its target is where it is. So with payload `pose_and_goal` a message holds where an evader is.

State: the robots (`state_layout.ROBOT`). Then of the evaders their positions, whether they are
captured, their velocities, whether they are alarmed, and the headings in which they wander; and
with a `sight_range` what each robot remembers of each evader (`sightings`).
Action: a command (`dynamics`).
Observation: that of the observation model, and for each robot and each evader
    offset_x, _y    m, in the world's frame, from the robot to where it saw the evader last
    velocity_x, _y  m/s, of the evader at that time
    age             time since then / 5 s
    mask            1 if it knows a place of the evader, which is free; else all of these are 0

Own reward of robot i, with weights w from `spec.rules.rewards`, d' and d its distances to its
target before and after the step, and [x] one if x holds, else zero:

    w.progress [it had a target before the step and has one after it, and no evader was captured]
    (d' - d) + w.capture (evaders that the team captured in this step) - w.time

The terms that all tasks share are added (`rewards`). Solved: all evaders are captured.
Metrics: see `Pursuit.metrics`.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from swarmdata.envs.pursuit.evader import EvaderModel, evade, random_bits
from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.envs.pursuit.sightings import (
    FREE,
    MEMORY_TIME,
    Columns,
    aim,
    pursuit_columns,
    remember,
    sighting,
)
from swarmdata.envs.world.spawn import (
    LAYOUT_OFFSET,
    PLACE_TRIES,
    SpawnPlan,
    density,
    direction_of,
    is_free_place,
    next_uniform,
    place_obstacles,
    put_at_rest,
)
from swarmdata.errors import SpawnError, SpecError
from swarmdata.registry.appearance import Appearance, Moment, SharedTargets
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, leading_to_places, numbered, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Episode, Float, Int, Metric, Seeds, Step, Term

SURROUND_DISTANCE = 1.2  # m from an evader within which robots surround it

EVADER_FEATURES: tuple[Feature, ...] = telling_goals(
    (
        *leading_to_places(
            vector("offset", "position", "where it saw the evader last minus own position")
        ),
        *vector("velocity", "velocity", "velocity of the evader when it saw it last"),
        Feature("age", "flag", "", f"time since it saw the evader / {MEMORY_TIME:g} s"),
        Feature("mask", "flag", "", "1 if it knows a place of the evader, which is free"),
    )
)
"""Of each evader, in every robot's observation."""


class Chase(NamedTuple):
    """Constants of the task, for kernels."""

    columns: Columns
    model: EvaderModel
    radii: Double  # [N] m
    sight_range: float  # m; not read where robots see everything
    captors: int


@kernel
def place_robots(
    state: Seeds, plan: SpawnPlan, corner: int, size: float, layout: Float, starts: Float
) -> bool:
    """Draws the robots' starts [N, 2] in a square in a corner; returns False if one found no place.

    The two bits of `corner` say whether it is at the right, and whether at the top. `size`: of its
    side, m.
    """
    for i in range(plan.radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            for axis in range(2):
                inside = plan.half[axis] - size * next_uniform(state)
                starts[i, axis] = inside if (corner >> axis) & 1 else -inside
            if is_free_place(starts, i, plan.radii, plan.starts, layout, plan.half):
                break
    return True


@kernel
def place_evaders(
    state: Seeds, plan: SpawnPlan, radii: Double, layout: Float, starts: Float, evaders: Float
) -> bool:
    """Draws the evaders' places [K, 2], away from all starts [N, 2]; False if one found none.

    `radii`: of the evaders, m, [K].
    """
    most = plan.min_goal_distance * plan.min_goal_distance
    for k in range(radii.shape[0]):
        for attempt in range(PLACE_TRIES + 1):
            if attempt == PLACE_TRIES:
                return False
            for axis in range(2):
                room = plan.half[axis] - radii[k]
                evaders[k, axis] = room * (2.0 * next_uniform(state) - 1.0)
            is_far = True
            for i in range(starts.shape[0]):
                dx = np.float64(starts[i, 0]) - np.float64(evaders[k, 0])
                dy = np.float64(starts[i, 1]) - np.float64(evaders[k, 1])
                is_far = bool(is_far and dx * dx + dy * dy >= most)
            if is_far and is_free_place(evaders, k, radii, plan.goals, layout, plan.half):
                break
    return True


@kernel
def start_pursuits(
    seeds: Seeds,  # [len(copies)] episode seeds
    copies: Int,  # rows to write
    plan: SpawnPlan,  # of the spec
    start_size: float,  # side of the square in which robots start, m
    radii: Double,  # [K] of the evaders, m
    sight_range: float,  # of the robots, m
    columns: Columns,  # of the states
    layouts: Float,  # [E, M, 8] written
    states: Float,  # [E, S] written
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    n, state = plan.radii.shape[0], np.empty(1, np.uint64)
    for c in range(copies.shape[0]):
        row, layout = states[copies[c]], layouts[copies[c]]
        row[:] = 0.0
        robots = row[: N_COLUMNS * n].reshape(n, N_COLUMNS)
        starts = robots[:, X : Y + 1]
        evaders = row[columns.places : columns.captured].reshape(columns.n_evaders, 2)
        state[0] = seeds[c] + np.uint64(LAYOUT_OFFSET)
        corner = int(4.0 * next_uniform(state))
        for attempt in range(plan.max_attempts + 1):
            if attempt == plan.max_attempts:
                return c
            if (
                place_obstacles(state, plan.sizes, plan.half, plan.obstacle_gap, layout)
                and place_robots(state, plan, corner, start_size, layout, starts)
                and place_evaders(state, plan, radii, layout, starts, evaders)
            ):
                break
        for i in range(n):
            put_at_rest(state, plan.has_heading[i], robots[i])
        for k in range(columns.n_evaders):
            u = columns.headings + 2 * k
            row[u], row[u + 1] = direction_of(next_uniform(state), next_uniform(state))
        for i in range(n):
            remember(row, i, layout, sight_range, 0.0, columns)
            aim(row, i, columns)
    return copies.shape[0]


@kernel
def places_of(state: Float, n: int) -> Double:
    """Positions of the robots, m, [N, 2]."""
    places = np.empty((n, 2))
    for i in range(n):
        places[i, 0], places[i, 1] = state[N_COLUMNS * i], state[N_COLUMNS * i + 1]
    return places


@kernel
def move_evader(
    new: Float, k: int, bits: np.uint64, robots: Double, moved: Double, layout: Float, chase: Chase
) -> None:
    """Moves evader k for a control step, in the state `new` [S].

    `robots`, `moved`: places of the robots before and after the step, m, [N, 2]; see `evade`.
    """
    columns, model = chase.columns, chase.model
    at, u, v = columns.places + 2 * k, columns.headings + 2 * k, columns.velocities + 2 * k
    place = (np.float64(new[at]), np.float64(new[at + 1]))
    facing, was_alarmed = (np.float64(new[u]), np.float64(new[u + 1])), new[columns.alarmed + k] > 0
    is_alarmed, new[u], new[u + 1], x, y = evade(
        place, facing, was_alarmed, bits, robots, moved, chase.radii, layout, model
    )
    new[columns.alarmed + k] = 1.0 if is_alarmed else 0.0
    new[at], new[at + 1] = x, y
    new[v], new[v + 1] = (x - place[0]) / model.dt, (y - place[1]) / model.dt


@kernel
def is_caught(state: Float, k: int, robots: Double, chase: Chase) -> bool:
    """Whether enough robots, at these places (m, [N, 2]), are within reach of evader k."""
    count, at = 0, chase.columns.places + 2 * k
    x, y, reach = np.float64(state[at]), np.float64(state[at + 1]), chase.model.capture_radius
    for i in range(robots.shape[0]):
        dx, dy = robots[i, 0] - x, robots[i, 1] - y
        count += dx * dx + dy * dy <= reach * reach
    return count >= chase.captors


@kernel
def has_target(state: Float, i: int, columns: Columns) -> bool:
    """Whether robot i knows a free evader."""
    is_known = False
    for k in range(columns.n_evaders):
        is_known = is_known or sighting(state, i, k, columns).status == FREE
    return is_known


@kernel
def target_distance(state: Float, i: int) -> float:
    """Distance from robot i to its target, m."""
    r = N_COLUMNS * i
    dx = np.float64(state[r + TX]) - np.float64(state[r])
    dy = np.float64(state[r + TY]) - np.float64(state[r + 1])
    return float(np.sqrt(dx * dx + dy * dy))


@kernel
def serve_pursuits(
    before: Float,  # [E, S] states before the step
    after: Float,  # states after the step; targets and extras, as before it, are updated
    layouts: Float,  # [E, M, 8]
    seeds: Seeds,  # [E]
    times: Int,  # [E] control steps since the reset, this one included
    active: Bool,  # [E]
    chase: Chase,  # constants
    terms: Float,  # [E, N, R] progress, capture and time are written
    solved: Bool,  # [E] written
) -> None:
    """Moves and captures evaders in the active copies, lets robots look, and scores the step."""
    columns, n = chase.columns, terms.shape[1]
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old, new, layout, left, n_captured = before[b], after[b], layouts[b], 0, 0
        robots, moved = places_of(old, n), places_of(new, n)
        for k in range(columns.n_evaders):
            if new[columns.captured + k] > 0.0:
                continue
            bits = random_bits(seeds[b], times[b], k)
            move_evader(new, k, bits, robots, moved, layout, chase)
            if is_caught(new, k, moved, chase):
                v = columns.velocities + 2 * k
                new[columns.captured + k] = 1.0
                new[v] = new[v + 1] = new[columns.alarmed + k] = 0.0
                n_captured += 1
            else:
                left += 1
        for i in range(n):
            had, length = has_target(old, i, columns), target_distance(old, i)
            remember(new, i, layout, chase.sight_range, chase.model.dt, columns)
            has = aim(new, i, columns)
            is_kept = had and has and n_captured == 0
            terms[b, i, 0] = length - target_distance(new, i) if is_kept else 0.0
            terms[b, i, 1], terms[b, i, 2] = n_captured, 1.0
        solved[b] = left == 0


@kernel
def write_pursuit_features(states: Float, active: Bool, columns: Columns, out: Float) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, F]."""
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        for i in range(out.shape[1]):
            x = np.float64(states[b, N_COLUMNS * i])
            y = np.float64(states[b, N_COLUMNS * i + 1])
            out[b, i] = 0.0
            for k in range(columns.n_evaders):
                known, at = sighting(states[b], i, k, columns), 6 * k
                if known.status == FREE:
                    out[b, i, at], out[b, i, at + 1] = known.x - x, known.y - y
                    out[b, i, at + 2], out[b, i, at + 3] = known.vx, known.vy
                    out[b, i, at + 4], out[b, i, at + 5] = known.age / MEMORY_TIME, 1.0


class Pursuit:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "evaders_captured": Metric(
            "evaders captured", "", "higher", "share of the evaders that are captured"
        ),
        "time_surrounded": Metric(
            "time surrounded",
            "",
            "higher",
            "share of the steps in which a free evader is in the convex hull of the robots "
            "within 1.2 m of it",
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(PursuitRules)
        _check_captors(spec, rules)
        self.spec = spec
        is_limited = rules.sight_range is not None
        self.columns = Columns.of(spec.n_agents, rules.evaders, is_limited)
        self._spawn, self._start_size = SpawnPlan.of(spec), rules.start_size
        self.kinds: Int = self._spawn.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras = pursuit_columns(spec, self.columns)
        self.features = numbered("evader", rules.evaders, EVADER_FEATURES)
        self._radii = np.full(rules.evaders, rules.evader_radius)
        self._chase = Chase(
            self.columns, EvaderModel.of(spec, rules), self._spawn.radii,
            rules.sight_range or 0.0, rules.captors,
        )  # fmt: skip
        self.terms = _terms(rules)
        self.solved = "all evaders are captured"

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(PursuitRules)
        is_limited = rules.sight_range is not None
        known = " Dashes lead from a robot to where it saw one last." if is_limited else ""
        return Appearance(
            legend=(
                f"Rings are evaders, filled once they are captured, which takes {rules.captors} "
                f"robots with their centers inside.{known}"
            ),
            radius=rules.capture_radius,
            shared=SharedTargets(rules.evaders, reached=2 * rules.evaders),
            is_linked=is_limited,
            moments=(Moment("capture", "captures an evader", "capture an evader"),),
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        drawn = start_pursuits(
            seeds, copies, self._spawn, self._start_size, self._radii, self._chase.sight_range,
            self.columns, layouts, states,
        )  # fmt: skip
        if drawn < len(copies):
            raise SpawnError(
                f"no layout found for seed {seeds[drawn]} in {self._spawn.max_attempts} attempts: "
                f"robots and obstacles with their gaps cover {density(self.spec):.0%} of the "
                f"arena, {self.spec.n_agents} robots start in a square of {self._start_size:g} m, "
                f"and evaders {self._spawn.min_goal_distance:g} m away. Use fewer or smaller "
                "obstacles, a larger start_size or a smaller spawn.min_goal_distance."
            )

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        serve_pursuits(
            before.states, now.states, now.layouts, now.seeds, now.times, active, self._chase,
            now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        write_pursuit_features(states, active, self.columns, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        captured = episode.states[-1, self.columns.captured : self.columns.velocities]
        return {
            "evaders_captured": float(captured.mean()),
            "time_surrounded": self._time_surrounded(episode),
        }

    def _time_surrounded(self, episode: Episode) -> float:
        """Share of the steps in which a free evader is in the hull of the robots around it."""
        c, states = self.columns, episode.states[1:].astype(np.float64)
        robots = robots_of(episode.states[1:], self.spec.n_agents)[:, None, :, : Y + 1]
        gaps = robots.astype(np.float64) - states[:, c.places : c.captured].reshape(
            -1, c.n_evaders, 1, 2
        )
        is_near = np.square(gaps).sum(-1) <= SURROUND_DISTANCE**2  # [T, K, N]
        x, y = gaps[..., 0], gaps[..., 1]
        is_left = x[..., :, None] * y[..., None, :] - y[..., :, None] * x[..., None, :] > 0.0
        goes_on = (is_left & is_near[..., None, :]).any(-1) | ~is_near
        is_surrounded = (
            goes_on.all(-1) & is_near.any(-1) & (states[:, c.captured : c.velocities] == 0)
        )
        return float(is_surrounded.any(-1).mean())


def _check_captors(spec: TaskSpec, rules: PursuitRules) -> None:
    if rules.captors > spec.n_agents:
        raise SpecError(
            f"captors is {rules.captors} in a team of {spec.n_agents} robots, expected at most "
            f"{spec.n_agents}. Use fewer captors or more robots."
        )
    radius = max(robot.radius for robot in spec.robots)
    least = radius + max(1.25 * radius * rules.captors**0.5, rules.evader_radius)
    if rules.capture_radius < least:
        raise SpecError(
            f"capture_radius is {rules.capture_radius:g} m, expected at least {least:.3g} m, so "
            f"that {rules.captors} robots of radius {radius:g} m fit around an evader."
        )
    if rules.start_size > min(spec.arena.width, spec.arena.height):
        raise SpecError(
            f"start_size is {rules.start_size:g} m in an arena of {spec.arena.width:g} m x "
            f"{spec.arena.height:g} m, expected at most its smaller side."
        )


def _terms(rules: PursuitRules) -> tuple[Term, ...]:
    w = rules.rewards
    way = (
        "d: distance, m, from the robot (x, y) to its target (tx, ty), both after the step; d': "
        "the same before the step. kept: before and after the step there was a free evader of "
        "which the robot knew a place (with a sight range, one of its columns known was 1), and "
        "no column captured changed in the step"
    )
    captured = "captured: evaders whose column captured went from 0 to 1"
    return (
        Term("progress", w.progress, 1, "[kept] * (d' - d)", way),
        Term("capture", w.capture, 1, "captured", captured),
        Term("time", w.time, -1, "1", "1: in every step"),
    )
