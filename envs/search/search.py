"""Search: N robots find victims among walls, and each victim needs several robots at a time.

Obstacles, starts and victims are drawn at random within `obstacles` and `spawn`; victims keep the
distances of goals. Robots start at rest.

A robot sees a victim, once for all, when it is within `sight_range` and no obstacle is between them
(`floor_memory`). A victim is rescued when at least `helpers` robots are within `goal_radius` of it
after the same control step; these have seen it then. Nobody else tells a robot of a victim: what a
robot has seen, the others learn from messages, or by looking themselves.

A robot's target is the nearest victim that it remembers and does not know to be rescued; of a
rescue it learns by seeing the victim again. If there is none, its target is the base: the corner of
the arena with the smallest x and y, where no victim can be. So with payload `pose_and_goal` a
message holds where a victim is, or the base.

State: the robots (`state_layout.ROBOT`). Then the positions of all victims, which of them are
rescued (0 or 1), what each robot knows of each victim, and which squares of the floor it has
searched (`floor_memory`).
Action: a command (`dynamics`).
Observation: that of the observation model, and for each robot
    knows           1 if its target is a victim, 0 if it is the base
    and for each of the `NEAREST_SQUARES` squares nearest to it that it has not searched
    offset_x, _y    m, in the world's frame, from the robot to the middle of the square
    mask            1; if there are fewer squares, 0 in the last slots, as their offsets
The places of victims that a robot has not seen are in none of these. With `observation.limit` or
its like, robots sense each other no farther than that either.

Own reward of robot i, with weights w from `spec.rules.rewards`, d' and d its distance before and
after the step to the target that it had before the step, and [x] one if x holds, else zero:

    w.progress [it knew a victim before the step] (d' - d) + w.sighting (victims that it sees for
    the first time) + w.searched (squares that it has now searched for the first time)
    + w.rescue (victims that the team rescued in this step) - w.time

The terms that all tasks share are added (`rewards`). Solved: all victims are rescued.
Metrics: see `Search.metrics`.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from swarmdata.envs.search.floor_memory import (
    Columns,
    cell_middles,
    close_cells,
    find_unsearched,
    knows_victim,
    look,
    search_definitions,
)
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.envs.world.spawn import LAYOUT_OFFSET, SpawnPlan, density, place_all, put_at_rest
from swarmdata.errors import SpawnError, SpecError
from swarmdata.registry.appearance import Appearance, Moment, SharedTargets
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, leading_to_places, numbered, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, pair
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Double, Episode, Float, Int, Metric, Seeds, Step, Term

NEAREST_SQUARES = 4  # squares that a robot has not searched and observes

_TO_SQUARE = "middle of a square that it has not searched minus own position"

TASK_FEATURES: tuple[Feature, ...] = (
    Feature("knows", "flag", "", "1 if its target is a victim, 0 if it is the base"),
    *telling_goals(
        numbered(
            "unsearched",
            NEAREST_SQUARES,
            (
                *leading_to_places(vector("offset", "position", _TO_SQUARE)),
                Feature("mask", "flag", "", "1 if the slot holds a square; nearest first"),
            ),
        )
    ),
)
"""Added by the task to every robot's observation."""


@kernel
def aim_at_victims(state: Float, half: Double, columns: Columns) -> None:
    """Sets the target of every robot: the nearest victim that it knows, or the base."""
    for i in range(columns.n_agents):
        r, least = N_COLUMNS * i, np.inf
        x, y = float(state[r]), float(state[r + 1])
        state[r + TX], state[r + TY] = -half[0], -half[1]
        for k in range(columns.n_victims):
            at = columns.victims + 2 * k
            dx, dy = float(state[at]) - x, float(state[at + 1]) - y
            if knows_victim(state, i, k, columns) and dx * dx + dy * dy < least:
                least = dx * dx + dy * dy
                state[r + TX], state[r + TY] = state[at], state[at + 1]


@kernel
def start_searches(
    seeds: Seeds,  # [len(copies)] episode seeds
    copies: Int,  # rows to write
    plan: SpawnPlan,  # of the spec
    victim_radii: Double,  # [K] radius that each victim's place needs, m
    middles: Double,  # [C, 2] of the squares, m
    sight_range: float,  # m
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
        victims = row[columns.victims : columns.rescued].reshape(columns.n_victims, 2)
        state[0] = seeds[c] + np.uint64(LAYOUT_OFFSET)
        if not place_all(state, plan, layout, starts, victim_radii, victims, victims, 0.0):
            return c
        close_cells(row, layout, middles, plan.half, plan.radii.max(), columns)
        for i in range(n):
            put_at_rest(state, plan.has_heading[i], robots[i])
            look(row, i, layout, middles, sight_range, columns)
        aim_at_victims(row, plan.half, columns)
    return copies.shape[0]


@kernel
def count_helpers(state: Float, k: int, goal_radius: float, columns: Columns) -> int:
    """How many robots are at victim k."""
    count, at = 0, columns.victims + 2 * k
    for i in range(columns.n_agents):
        dx = float(state[at]) - float(state[N_COLUMNS * i])
        dy = float(state[at + 1]) - float(state[N_COLUMNS * i + 1])
        count += dx * dx + dy * dy <= goal_radius * goal_radius
    return count


@kernel
def approach(old: Float, new: Float, i: int, columns: Columns) -> float:
    """Metres by which robot i came closer to the victim that it knew before the step; 0 if none."""
    knew = False
    for k in range(columns.n_victims):
        knew = knew or knows_victim(old, i, k, columns)
    if not knew:
        return 0.0
    r = N_COLUMNS * i
    tx, ty = float(old[r + TX]), float(old[r + TY])
    before = np.sqrt((tx - float(old[r])) ** 2 + (ty - float(old[r + 1])) ** 2)
    after = np.sqrt((tx - float(new[r])) ** 2 + (ty - float(new[r + 1])) ** 2)
    return float(before - after)


@kernel
def serve_searches(
    before: Float,  # [E, S] states before the step
    after: Float,  # states after the step; targets and extras, as before it, are updated
    layouts: Float,  # [E, M, 8]
    active: Bool,  # [E]
    middles: Double,  # [C, 2] of the squares, m
    half: Double,  # [2] half width and half height of the arena, m
    rules: tuple[float, float, int],  # sight range, m; goal radius, m; helpers
    columns: Columns,  # of the states
    terms: Float,  # [E, N, R] progress, sighting, searched, rescue and time are written
    solved: Bool,  # [E] written
) -> None:
    """Lets robots look and rescue in the active copies, and scores the step."""
    sight_range, goal_radius, helpers = rules
    n = terms.shape[1]
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old, new, left, n_rescued = before[b], after[b], 0, 0
        for k in range(columns.n_victims):
            if new[columns.rescued + k] == 0.0:
                if count_helpers(new, k, goal_radius, columns) >= helpers:
                    new[columns.rescued + k] = 1.0
                    n_rescued += 1
                else:
                    left += 1
        for i in range(n):
            sighted, searched = look(new, i, layouts[b], middles, sight_range, columns)
            terms[b, i, 0] = approach(old, new, i, columns)
            terms[b, i, 1], terms[b, i, 2] = sighted, searched
            terms[b, i, 3], terms[b, i, 4] = n_rescued, 1.0
        aim_at_victims(new, half, columns)
        solved[b] = left == 0


@kernel
def write_search_features(
    states: Float, active: Bool, middles: Double, columns: Columns, out: Float
) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, F]."""
    squares = np.empty(NEAREST_SQUARES, np.int64)
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        for i in range(out.shape[1]):
            x, y = float(states[b, N_COLUMNS * i]), float(states[b, N_COLUMNS * i + 1])
            out[b, i] = 0.0
            for k in range(columns.n_victims):
                if knows_victim(states[b], i, k, columns):
                    out[b, i, 0] = 1.0
            for slot in range(find_unsearched(states[b], i, x, y, middles, columns, squares)):
                c, at = squares[slot], 1 + 3 * slot
                out[b, i, at], out[b, i, at + 1] = middles[c, 0] - x, middles[c, 1] - y
                out[b, i, at + 2] = 1.0


class Search:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "victims_found": Metric("victims found", "", "higher", "victims that a robot has seen"),
        "victims_rescued": Metric("victims rescued", "", "higher", "victims that are rescued"),
        "floor_searched": Metric(
            "floor searched", "", "higher", "share of the squares that a robot has searched"
        ),
        "time_alone": Metric(
            "time alone",
            "s",
            "lower",
            "time that a robot is at a victim without enough others, mean over robots",
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(SearchRules)
        _check_helpers(spec, rules)
        self.spec = spec
        self.middles = cell_middles(spec, rules)
        self.columns = Columns.of(spec.n_agents, rules.victims, len(self.middles))
        self._spawn = SpawnPlan.of(spec)
        self.kinds: Int = self._spawn.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras = _extras(spec, rules.victims, len(self.middles))
        self.features = TASK_FEATURES
        self._rules = (rules.sight_range, rules.goal_radius, rules.helpers)
        self._victim_radii = np.full(rules.victims, self._spawn.radii.max())
        self.terms, self.definitions = _terms(rules), search_definitions(spec, rules)
        self.solved = "all victims are rescued"

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(SearchRules)
        return Appearance(
            legend=(
                "Rings are victims: dotted until a robot has seen them, then whole, and filled "
                "once they are rescued. Dashes lead from a robot to the victim that it knows."
            ),
            radius=rules.goal_radius,
            shared=SharedTargets(rules.victims, 2 * rules.victims, known=3 * rules.victims),
            is_linked=True,
            nowhere=(-spec.half_size[0], -spec.half_size[1]),
            moments=(
                Moment("sighting", "sees a victim first", "see a victim first"),
                Moment("rescue", "rescues a victim", "rescue a victim"),
            ),
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        drawn = start_searches(
            seeds, copies, self._spawn, self._victim_radii, self.middles, self._rules[0],
            self.columns, layouts, states,
        )  # fmt: skip
        if drawn < len(copies):
            raise SpawnError(
                f"no layout found for seed {seeds[drawn]} in {self._spawn.max_attempts} attempts: "
                f"robots and obstacles with their gaps cover {density(self.spec):.0%} of the "
                f"arena, and {self.columns.n_victims} victims need places too. Use fewer or "
                "smaller obstacles, or fewer victims."
            )

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        serve_searches(
            before.states, now.states, now.layouts, active, self.middles, self._spawn.half,
            self._rules, self.columns, now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        write_search_features(states, active, self.middles, self.columns, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        c, n = self.columns, self.spec.n_agents
        last = episode.states[-1].astype(np.float64)
        seen = last[c.known : c.searched].reshape(n, -1).any(0)
        searched = last[c.searched :].reshape(n, -1).any(0)
        return {
            "victims_found": float(seen.sum()),
            "victims_rescued": float(last[c.rescued : c.known].sum()),
            "floor_searched": float(searched.mean()),
            "time_alone": self._time_alone(episode),
        }

    def _time_alone(self, episode: Episode) -> float:
        """Seconds that a robot is at a victim that is not rescued, mean over robots."""
        c, n, states = self.columns, self.spec.n_agents, episode.states[1:].astype(np.float64)
        robots = states[:, : N_COLUMNS * n].reshape(-1, n, 1, N_COLUMNS)[..., : Y + 1]
        victims = states[:, c.victims : c.rescued].reshape(-1, 1, c.n_victims, 2)
        is_there = np.square(robots - victims).sum(-1) <= self._rules[1] ** 2  # [T, N, K]
        waits = is_there & (states[:, None, c.rescued : c.known] == 0.0)
        return float(waits.any(-1).sum()) * self.spec.control_dt / n


def _check_helpers(spec: TaskSpec, rules: SearchRules) -> None:
    if rules.helpers > spec.n_agents:
        raise SpecError(
            f"helpers is {rules.helpers} in a team of {spec.n_agents} robots, expected at most "
            f"{spec.n_agents}. Use fewer helpers or more robots."
        )
    radius = max(robot.radius for robot in spec.robots)
    least = 1.25 * radius * (rules.helpers**0.5)
    if rules.goal_radius < least:
        raise SpecError(
            f"goal_radius is {rules.goal_radius:g} m, expected at least {least:.3g} m, so that "
            f"{rules.helpers} robots of radius {radius:g} m fit around a victim."
        )


def _extras(spec: TaskSpec, n_victims: int, n_cells: int) -> tuple[Column, ...]:
    places = (
        column
        for k in range(n_victims)
        for column in pair(f"victim_{k}.", "position of the victim", "m", spec.half_size)
    )
    rescued = (
        Column(f"victim_{k}.rescued", "1 once it is rescued, else 0", low=0, high=1)
        for k in range(n_victims)
    )
    known = (
        Column(
            f"{name}.known_{k}",
            f"of victim {k}: 0 until it sees it, then 1; 2 once it sees that it is rescued",
            low=0,
            high=2,
        )
        for name in spec.agent_names
        for k in range(n_victims)
    )
    searched = (
        Column(f"{name}.searched_{c}", f"1 once it has searched square {c}, else 0", low=0, high=1)
        for name in spec.agent_names
        for c in range(n_cells)
    )
    return (*places, *rescued, *known, *searched)


def _terms(rules: SearchRules) -> tuple[Term, ...]:
    w = rules.rewards
    way = (
        "d: distance, m, from the robot (x, y) after the step to the target (tx, ty) that it had "
        "before the step; d': the same from where the robot was before the step. knew: before the "
        "step one of the robot's columns known was 1"
    )
    return (
        Term("progress", w.progress, 1, "[knew] * (d' - d)", way),
        Term(
            "sighting", w.sighting, 1, "sighted", "sighted: columns known that were 0 and are not"
        ),
        Term(
            "searched", w.searched, 1, "squares", "squares: columns searched that went from 0 to 1"
        ),
        Term("rescue", w.rescue, 1, "rescued", "rescued: victims whose rescued went from 0 to 1"),
        Term("time", w.time, -1, "1", "1: in every step"),
    )
