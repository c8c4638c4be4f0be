"""Warehouse: N robots fetch goods between shelves and deliver them at stations, order after order.

The floor is that of `floor_plan`, the same in every episode; the spec has no other obstacles.
Robots start at rest anywhere on it (`spawn.start_clearance`, `spawn.start_separation`). Order q of
robot i names a place and a station, each drawn uniformly, as a function of the episode's seed, i
and q alone (`draw_place`, `draw_station`). The robot drives to the place, picks up by being within
`goal_radius` of it after a control step, drives to the station, delivers in the same way, and gets
its next order at once. Several robots may have the same place or station.

State: the robots (`state_layout.ROBOT`); a robot's target is the place of its order, or the station
while it carries. Then, for each robot, `carrying` (0 or 1) and `deliveries` (how many it has made,
which is also the number q of its order).
Action: a command (`dynamics`).
Observation: that of the observation model, and for each robot
    carrying                0 or 1; tells the kind of its target, a place (0) or a station (1)
    corner_x, corner_y      m, in the world's frame, from the robot to the point where it should
                            drive next on its shortest path (`floor_plan.next_corner`)

Own reward of robot i, with weights w from `spec.rules.rewards`, L' and L the length of its shortest
path (`floor_plan.shortest_path_length`, along the axes and around shelves) before and after the
step to the target that it had before the step, and [x] one if x holds, else zero:

    w.progress (L' - L) + w.pickup [it picked] + w.delivery [it delivered] - w.time

The terms that all tasks share are added (`rewards`). Solved: the team has made `quota` deliveries.

Metrics: see `Warehouse.metrics`; `deadlocks` defines a deadlock.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from swarmdata.envs.warehouse.floor_plan import FloorPlan, next_corner, shortest_path_length
from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.envs.world.deadlocks import DEADLOCK_MEANING, count_deadlocks
from swarmdata.envs.world.spawn import SpawnPlan, check_fixed_layout, place_points, put_at_rest
from swarmdata.errors import SpawnError
from swarmdata.numerics.random import DRAW_MEANING, STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.registry.appearance import Appearance, Moment
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Double, Episode, Float, Int, Metric, Seeds, Step, Term

ROBOT_EXTRAS = (
    Column("carrying", "1 while it carries goods to a station, its target; else 0", low=0, high=1),
    Column(
        "deliveries", "orders that it has delivered; also the number of its present order", low=0
    ),
)
"""The task's own columns of a state, for each robot."""

TASK_FEATURES: tuple[Feature, ...] = (
    Feature("carrying", "flag", "", "1 while it carries goods to a station, its target"),
    *telling_goals(
        vector("corner", "position", "next corner of its shortest path minus own position")
    ),
)
"""Added by the task to every robot's observation."""

_LAYOUT_STREAM = STREAMS["layout"]


@kernel(inline="always")
def draw_place(seed: np.uint64, robot: int, order: int, n_picks: int) -> int:
    """Index of the place of a robot's order, uniform below `n_picks`."""
    bits = absorb(absorb(absorb(absorb(seed, _LAYOUT_STREAM), robot), order), 0)
    return int(to_uniform(bits) * n_picks)


@kernel(inline="always")
def draw_station(seed: np.uint64, robot: int, order: int, n_stations: int) -> int:
    """Index of the station of a robot's order, uniform below `n_stations`."""
    bits = absorb(absorb(absorb(absorb(seed, _LAYOUT_STREAM), robot), order), 1)
    return int(to_uniform(bits) * n_stations)


@kernel
def start_episodes(
    seeds: Seeds,  # [len(copies)] episode seeds
    copies: Int,  # rows to write
    plan: SpawnPlan,  # of the spec
    shelves: Float,  # [M, 8]
    places: Double,  # [P + K, 2] of the floor plan
    n_picks: int,  # of the floor plan, P
    layouts: Float,  # [E, M, 8] written
    states: Float,  # [E, S] written
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    n = plan.radii.shape[0]
    state = np.empty(1, np.uint64)
    for c in range(copies.shape[0]):
        layouts[copies[c]] = shelves
        state[0] = absorb(seeds[c], _LAYOUT_STREAM)
        row = states[copies[c]]
        row[:] = 0.0
        robots = row[: N_COLUMNS * n].reshape(n, N_COLUMNS)
        starts, found = robots[:, X : Y + 1], False
        for _ in range(plan.max_attempts):
            found = place_points(
                state, shelves, plan.half, plan.radii, plan.starts, starts, starts, 0.0
            )
            if found:
                break
        if not found:
            return c
        for i in range(n):
            put_at_rest(state, plan.has_heading[i], robots[i])
            k = draw_place(seeds[c], i, 0, n_picks)
            robots[i, TX], robots[i, TY] = places[k, 0], places[k, 1]
    return copies.shape[0]


@kernel
def serve_orders(
    before: Float,  # [E, S] states before the step
    after: Float,  # states after the step; targets and extras, as before it, are updated
    seeds: Seeds,  # [E]
    active: Bool,  # [E]
    lanes: Double,  # [L, 2] of the floor plan
    rows: Double,  # [3] of the floor plan
    places: Double,  # [P + K, 2] of the floor plan
    rules: tuple[int, float, int],  # P; goal radius, m; quota
    terms: Float,  # [E, N, R] progress, pickup, delivery and time are written
    solved: Bool,  # [E] written
) -> None:
    """Lets robots pick up and deliver in the active copies, draws orders, and scores the step.

    `rules` is a plain tuple, since named ones are slower to pass.
    """
    n_picks, goal_radius, quota = rules
    n = terms.shape[1]
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old, new, total = before[b], after[b], 0
        for i in range(n):
            r, extra = N_COLUMNS * i, N_COLUMNS * n + 2 * i  # its columns, and its extras
            x, y, tx, ty = float(new[r]), float(new[r + 1]), float(new[r + TX]), float(new[r + TY])
            length = shortest_path_length(float(old[r]), float(old[r + 1]), tx, ty, lanes, rows)
            length -= shortest_path_length(x, y, tx, ty, lanes, rows)
            own = terms[b, i]
            own[0], own[1], own[2], own[3] = length, 0.0, 0.0, 1.0
            if (tx - x) * (tx - x) + (ty - y) * (ty - y) <= goal_radius * goal_radius:
                order = int(new[extra + 1])
                if new[extra] > 0.0:
                    new[extra], new[extra + 1] = 0.0, order + 1.0
                    k = draw_place(seeds[b], i, order + 1, n_picks)
                    own[2] = 1.0
                else:
                    new[extra] = 1.0
                    k = n_picks + draw_station(seeds[b], i, order, places.shape[0] - n_picks)
                    own[1] = 1.0
                new[r + TX], new[r + TY] = places[k, 0], places[k, 1]
            total += int(new[extra + 1])
        solved[b] = total >= quota


@kernel
def write_warehouse_features(
    states: Float, active: Bool, lanes: Double, rows: Double, middles: Double, out: Float
) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, 3]."""
    n = out.shape[1]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        for i in range(n):
            r = N_COLUMNS * i
            x, y = float(states[b, r]), float(states[b, r + 1])
            target = (float(states[b, r + TX]), float(states[b, r + TY]))
            corner_x, corner_y = next_corner(x, y, target, lanes, rows, middles)
            out[b, i, 0] = states[b, N_COLUMNS * n + 2 * i]
            out[b, i, 1], out[b, i, 2] = corner_x - x, corner_y - y


class Warehouse:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "deliveries": Metric("deliveries", "", "higher", "orders delivered by the team"),
        "throughput": Metric(
            "throughput", "1/min", "higher", "deliveries per robot and minute of the episode"
        ),
        "deadlocks": Metric(
            "deadlocks",
            "",
            "lower",
            "times that robots within 0.3 m of each other began to stand still for 3 s",
        ),
        "carrying_time": Metric(
            "carrying time", "", "higher", "share of the time that robots carry, mean over robots"
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(WarehouseRules)
        check_fixed_layout(spec, "task 'warehouse'")
        self.spec, self.plan = spec, FloorPlan.of(spec)
        self.kinds: Int = self.plan.shelves[:, 0].astype(np.int64)
        self.movables: tuple[Payload, ...] = ()
        self.extras = tuple(
            own._replace(name=f"{name}.{own.name}")
            for name in spec.agent_names
            for own in ROBOT_EXTRAS
        )
        self.features = TASK_FEATURES
        self._spawn = SpawnPlan.of(spec)
        self._rules = (self.plan.n_picks, rules.goal_radius, rules.quota)
        self.definitions = _definitions(rules, self.plan)
        self.terms = _terms(rules, self.plan)
        self.solved = f"the team has made {rules.quota} deliveries"

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(WarehouseRules)
        return Appearance(
            legend=("Rings are places and stations of the robots' orders; a small box is carried."),
            radius=rules.goal_radius,
            carrying=tuple(len(ROBOT_EXTRAS) * i for i in range(spec.n_agents)),
            moments=(
                Moment("pickup", "picks up", "pick up"),
                Moment("delivery", "delivers", "deliver"),
            ),
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        plan = self.plan
        drawn = start_episodes(
            seeds, copies, self._spawn, plan.shelves, plan.places, plan.n_picks, layouts, states
        )
        if drawn < len(copies):
            raise SpawnError(
                f"no starts found for seed {seeds[drawn]} in {self._spawn.max_attempts} attempts: "
                f"{self.spec.n_agents} robots with their gaps do not fit between the shelves. "
                "Use a larger arena, fewer robots, or a smaller spawn.start_separation."
            )

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        serve_orders(
            before.states, now.states, now.seeds, active, self.plan.lanes, self.plan.rows,
            self.plan.places, self._rules, now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        plan = self.plan
        write_warehouse_features(states, active, plan.lanes, plan.rows, plan.middles, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        n, seconds = self.spec.n_agents, len(episode) * self.spec.control_dt
        positions = robots_of(episode.states, n)[..., : Y + 1].astype(np.float64)
        extras = episode.states[:, N_COLUMNS * n :].reshape(-1, n, len(ROBOT_EXTRAS))
        carrying, delivered = np.moveaxis(extras.astype(np.float64), -1, 0)  # [T+1, N] each
        deliveries = float(delivered[-1].sum())
        return {
            "deliveries": deliveries,
            "throughput": deliveries / n / (seconds / 60.0),
            "deadlocks": float(count_deadlocks(positions, self._spawn.radii, self.spec.control_dt)),
            "carrying_time": float(carrying[:-1].mean()),
        }


def _definitions(rules: WarehouseRules, plan: FloorPlan) -> dict[str, str]:
    points = [f"({x:.9g}, {y:.9g})" for x, y in plan.places.tolist()]
    picks, stations = points[: plan.n_picks], points[plan.n_picks :]
    middles = ", ".join(f"{y:.9g}" for y in plan.middles.tolist())
    return {
        "corner": (
            "Lanes and corridors are those of the term `progress`; above the last corridor is "
            "the last one. If y and ty are in the same corridor: (tx, ty). Else m is the middle "
            "of the lane with the smallest gap to the interval from x to tx, of several that "
            "nearest to x, of these the first: (m, middle of ty's corridor) if x is in the lane "
            "or y beside shelves, else (m, middle of y's corridor). Middles of the corridors 0, "
            f"1, ..., m: {middles}. (x, y) is where the robot believes to be"
        ),
        "tx, ty": (
            f"Order q of robot i is from place floor({plan.n_picks} u) to station "
            f"floor({len(stations)} v), u = uniform(derive(seed, {_LAYOUT_STREAM}, i, q, 0)) and v "
            f"= uniform(derive(seed, {_LAYOUT_STREAM}, i, q, 1)). The target is the place, and the "
            "station while `carrying` is 1. After a step that the robot ends within "
            f"{rules.goal_radius:g} m of its target, `carrying` turns 1, or it turns 0 and "
            "`deliveries`, the number q of the order, rises by 1"
        ),
        "places": f"Numbered from 0, m: {', '.join(picks)}",
        "stations": f"Numbered from 0, m: {', '.join(stations)}",
        "derive, uniform": f"{DRAW_MEANING}. seed: of the episode, in `episodes/seeds`",
        "deadlocks": DEADLOCK_MEANING,
    }


def _terms(rules: WarehouseRules, plan: FloorPlan) -> tuple[Term, ...]:
    w, (first, pitch, depth) = rules.rewards, plan.rows.tolist()
    lanes = ", ".join(f"[{low:.9g}, {high:.9g}]" for low, high in plan.lanes.tolist())
    path = (
        "L: length of the shortest path along the axes, m, from the robot (x, y) after the step to "
        "the target (tx, ty) that it had before the step; L': the same from where the robot was "
        "before the step. L is |tx - x| + |ty - y| if y and ty are in the same corridor; otherwise "
        "it is longer by twice the smallest gap between a lane and the interval from x to tx. "
        f"Lanes in x: {lanes}. Corridors: with u = y - ({first:.9g}), y is in corridor 0 if u < 0; "
        f"otherwise, with k = floor(u / {pitch:.9g}), it is in corridor k + 1 if "
        f"u - k * {pitch:.9g} >= {depth:.9g}, and beside shelves, in corridor -1, if not"
    )
    return (
        Term("progress", w.progress, 1, "(L' - L)", path),
        Term("pickup", w.pickup, 1, "[picked]", "picked: carrying went from 0 to 1"),
        Term("delivery", w.delivery, 1, "[delivered]", "delivered: deliveries went up by 1"),
        Term("time", w.time, -1, "1", "1: in every step"),
    )
