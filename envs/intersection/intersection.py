"""Intersection: N robots cross from arm to arm on schedules, and nobody has the right of way.

The floor is that of `junction`, the same in every episode; the spec has no other obstacles. Robots
start at rest near the gates of the arms, N / 4 in each: the first robot of an arm in its entry, the
second in its exit, and any others behind that, on the side of those who drive out. Which robot is
where, and which arm has one robot more, is drawn; each start is moved by up to `START_JITTER` along
both axes.

Trip q of robot i begins at the entry of the arm that it is in, and ends at the exit of another arm,
drawn uniformly (`draw_exit`). It may begin `due` seconds after the start of the episode, drawn
uniformly between q and q + 1 times `headway` (`due_time`). Both are functions of the episode's
seed, i and q alone. A robot enters by being within `goal_radius` of its entry after a control step
when its trip is due; before, it waits. It leaves by being within `goal_radius` of its exit, and its
next trip begins at the entry of the same arm.

So two lines of robots share each arm, and in the middle square up to N robots want to cross each
other's way. The rules give no right of way: robots that all wait are as stuck as robots that block
each other.

State: the robots (`state_layout.ROBOT`); a robot's target is its entry, or its exit while it
crosses. Then, for each robot, `crossing` (0 or 1), `crossings` (how many trips it has ended, which
is also the number q of its trip) and `wait` (s until it may enter; 0 while it crosses).
Action: a command (`dynamics`).
Observation: that of the observation model, and for each robot
    crossing                0 or 1; tells the kind of its target, an entry (0) or an exit (1)
    wait                    the part of `headway` that is left until it may enter, at most 1
    corner_x, corner_y      m, in the world's frame, from the robot to the point where it should
                            drive next on its shortest path (`junction.next_corner`)
What the other robots want is in none of these. Robots learn it from messages: with payload
`pose_and_goal`, a message holds the sender's target.

Own reward of robot i, with weights w from `spec.rules.rewards`, L' and L the length |dx| + |dy| of
its path before and after the step to the target that it had before the step, and [x] one if x
holds, else zero:

    w.progress (L' - L) + w.entry [it entered] + w.crossing [it left] - w.time

The terms that all tasks share are added (`rewards`). Solved: the team has made `quota` crossings.

Metrics: see `Intersection.metrics`; `deadlocks` defines a deadlock.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

import numpy as np

from swarmdata.envs.intersection.intersection_rules import IntersectionRules
from swarmdata.envs.intersection.junction import (
    ARM_DIRECTIONS,
    N_ARMS,
    Junction,
    arm_at,
    next_corner,
)
from swarmdata.envs.world.deadlocks import DEADLOCK_MEANING, count_deadlocks
from swarmdata.envs.world.spawn import LAYOUT_OFFSET, check_fixed_layout, next_uniform, put_at_rest
from swarmdata.errors import SpecError
from swarmdata.numerics.random import DRAW_MEANING, STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.registry.appearance import Appearance, Moment
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Double, Episode, Float, Int, Metric, Seeds, Step, Term

START_JITTER = 0.03  # largest distance of a start from the middle of its place, along each axis, m


class StartPlan(NamedTuple):
    """What starts depend on."""

    places: Double  # [4, R, 2] middle of each place in each arm, R robots at most
    radii: Double  # [N] m
    has_heading: Bool  # [N] whether a robot's heading is drawn

    @classmethod
    def of(cls, spec: TaskSpec, junction: Junction) -> Self:
        """The plan of a spec; raises a `SpecError` if the arms are too short for the robots."""
        radii = np.array([robot.radius for robot in spec.robots])
        gap = spec.spawn.start_separation + 2 * START_JITTER
        n_rows = -(-spec.n_agents // N_ARMS)
        behind = (2 * float(radii.max()) + gap) * np.arange(1, max(n_rows - 1, 1))
        queue = junction.exits[:, None] - behind[:, None] * ARM_DIRECTIONS[:, None]
        gates = np.stack([junction.entries, junction.exits], axis=1)
        places = np.concatenate([gates, queue], axis=1)[:, :n_rows]
        innermost = (places * ARM_DIRECTIONS[:, None]).sum(-1).min()
        if innermost < junction.half_width + radii.max():
            raise SpecError(
                f"{n_rows} robots with gaps of {gap:g} m do not fit in an arm of this "
                "intersection. Use a larger arena, fewer robots, or a smaller "
                "spawn.start_separation."
            )
        has_heading = np.array([robot.dynamics == "unicycle" for robot in spec.robots])
        return cls(np.ascontiguousarray(places), radii, has_heading)


@kernel
def draw_starts(seeds: Seeds, copies: Int, plan: StartPlan, states: Float) -> None:
    """Draws where the robots of the episodes `seeds` [C] start, at rest; the rest of a state is 0.

    They are written to the rows `copies` of `states` [E, S].
    """
    n = plan.radii.shape[0]
    state, order = np.empty(1, np.uint64), np.empty(n, np.int64)
    for c in range(copies.shape[0]):
        row = states[copies[c]]
        row[:] = 0.0
        state[0] = seeds[c] + np.uint64(LAYOUT_OFFSET)
        first = int(N_ARMS * next_uniform(state))
        for k in range(n):  # a random order, from the inside out (Knuth's Algorithm P)
            j = int((k + 1) * next_uniform(state))
            order[k] = order[j]
            order[j] = k
        for i in range(n):
            robot = row[N_COLUMNS * i : N_COLUMNS * (i + 1)]
            place = plan.places[(order[i] + first) % N_ARMS, order[i] // N_ARMS]
            robot[X] = place[0] + START_JITTER * (2.0 * next_uniform(state) - 1.0)
            robot[Y] = place[1] + START_JITTER * (2.0 * next_uniform(state) - 1.0)
            put_at_rest(state, plan.has_heading[i], robot)


ROBOT_EXTRAS = (
    Column("crossing", "1 while it drives to an exit, its target; else 0", low=0, high=1),
    Column("crossings", "trips that it has ended; also the number of its present trip", low=0),
    Column("wait", "time until it may enter, 0 while it crosses", "s", low=0),
)
"""The task's own columns of a state, for each robot."""

N_EXTRAS = len(ROBOT_EXTRAS)

CROSSING, CROSSINGS, WAIT = range(N_EXTRAS)

TASK_FEATURES: tuple[Feature, ...] = (
    Feature("crossing", "flag", "", "1 while it drives to an exit, its target"),
    Feature("wait", "flag", "", "time until it may enter / headway, at most 1"),
    *telling_goals(
        vector("corner", "position", "next corner of its shortest path minus own position")
    ),
)
"""Added by the task to every robot's observation."""

STILL_SPEED = 0.05  # speed (m/s) below which a robot stands, for the metric `waiting_time`

_LAYOUT_STREAM = STREAMS["layout"]


@kernel(inline="always")
def draw_exit(seed: np.uint64, robot: int, trip: int, arm: int) -> int:
    """The arm at which a trip that begins in `arm` ends, uniform among the three others."""
    bits = absorb(absorb(absorb(absorb(seed, _LAYOUT_STREAM), robot), trip), 0)
    return (arm + 1 + int(to_uniform(bits) * (N_ARMS - 1))) % N_ARMS


@kernel(inline="always")
def due_time(seed: np.uint64, robot: int, trip: int, headway: float) -> float:
    """When a trip may begin, s after the start of the episode."""
    bits = absorb(absorb(absorb(absorb(seed, _LAYOUT_STREAM), robot), trip), 1)
    return (trip + to_uniform(bits)) * headway


@kernel
def start_trips(seeds: Seeds, copies: Int, entries: Double, headway: float, states: Float) -> None:
    """Gives the robots, which are at their starts, their first trips, in rows `copies` of `states`.

    `seeds`: of the episodes, [C]. `entries`: of the junction, m, [4, 2]. `headway`: s.
    """
    for c in range(copies.shape[0]):
        row = states[copies[c]]
        n = row.shape[0] // (N_COLUMNS + N_EXTRAS)
        for i in range(n):
            r, extra = N_COLUMNS * i, N_COLUMNS * n + N_EXTRAS * i
            arm = arm_at(float(row[r]), float(row[r + 1]))
            row[r + TX], row[r + TY] = entries[arm, 0], entries[arm, 1]
            row[extra + WAIT] = due_time(seeds[c], i, 0, headway)


@kernel
def serve_trips(
    before: Float,  # [E, S] states before the step
    after: Float,  # states after the step; targets and extras, as before it, are updated
    seeds: Seeds,  # [E]
    times: Int,  # [E] control steps since the reset, this one included
    active: Bool,  # [E]
    entries: Double,  # [4, 2] of the junction
    exits: Double,  # [4, 2] of the junction
    rules: tuple[float, float, int, float],  # goal radius, m; headway, s; quota; control step, s
    terms: Float,  # [E, N, R] progress, entry, crossing and time are written
    solved: Bool,  # [E] written
) -> None:
    """Lets robots enter and leave in the active copies, and scores the step."""
    goal_radius, headway, quota, dt = rules
    n = terms.shape[1]
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old, new, total = before[b], after[b], 0
        for i in range(n):
            r, extra = N_COLUMNS * i, N_COLUMNS * n + N_EXTRAS * i
            x, y, tx, ty = float(new[r]), float(new[r + 1]), float(new[r + TX]), float(new[r + TY])
            own, trip = terms[b, i], int(new[extra + CROSSINGS])
            length = abs(tx - float(old[r])) + abs(ty - float(old[r + 1]))
            length -= abs(tx - x) + abs(ty - y)
            own[0], own[1], own[2], own[3] = length, 0.0, 0.0, 1.0
            is_there = (tx - x) * (tx - x) + (ty - y) * (ty - y) <= goal_radius * goal_radius
            arm, is_due = arm_at(tx, ty), due_time(seeds[b], i, trip, headway) <= times[b] * dt
            if new[extra + CROSSING] > 0.0 and is_there:
                new[extra + CROSSING], trip = 0.0, trip + 1
                new[extra + CROSSINGS] = trip
                new[r + TX], new[r + TY] = entries[arm, 0], entries[arm, 1]
                own[2] = 1.0
            elif new[extra + CROSSING] == 0.0 and is_there and is_due:
                arm = draw_exit(seeds[b], i, trip, arm)
                new[extra + CROSSING] = 1.0
                new[r + TX], new[r + TY] = exits[arm, 0], exits[arm, 1]
                own[1] = 1.0
            left = due_time(seeds[b], i, trip, headway) - times[b] * dt
            new[extra + WAIT] = max(left, 0.0) if new[extra + CROSSING] == 0.0 else 0.0
            total += trip
        solved[b] = total >= quota


@kernel
def write_intersection_features(
    states: Float, active: Bool, half_width: float, headway: float, out: Float
) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, 4]."""
    n = out.shape[1]
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        for i in range(n):
            r, extra = N_COLUMNS * i, N_COLUMNS * n + N_EXTRAS * i
            x, y = float(states[b, r]), float(states[b, r + 1])
            tx, ty = float(states[b, r + TX]), float(states[b, r + TY])
            corner_x, corner_y = next_corner(x, y, tx, ty, half_width)
            out[b, i, 0] = states[b, extra + CROSSING]
            out[b, i, 1] = min(float(states[b, extra + WAIT]) / headway, 1.0)
            out[b, i, 2], out[b, i, 3] = corner_x - x, corner_y - y


class Intersection:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "crossings": Metric("crossings", "", "higher", "trips that the team ended"),
        "throughput": Metric(
            "throughput", "1/min", "higher", "crossings of the team per minute of the episode"
        ),
        "waiting_time": Metric(
            "waiting time",
            "s",
            "lower",
            "time that a robot stands (below 0.05 m/s) though its trip is due, mean over robots",
        ),
        "deadlocks": Metric(
            "deadlocks",
            "",
            "lower",
            "times that robots within 0.3 m of each other, with trips that are due, began to "
            "stand still for 3 s",
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(IntersectionRules)
        check_fixed_layout(spec, "task 'intersection'")
        self.spec, self.junction = spec, Junction.of(spec)
        self.kinds: Int = self.junction.corners[:, 0].astype(np.int64)
        self.movables: tuple[Payload, ...] = ()
        self.extras = tuple(
            own._replace(name=f"{name}.{own.name}")
            for name in spec.agent_names
            for own in ROBOT_EXTRAS
        )
        self.features = TASK_FEATURES
        self._starts = StartPlan.of(spec, self.junction)
        self._headway = rules.headway
        self._rules = (rules.goal_radius, rules.headway, rules.quota, spec.control_dt)
        self.terms = _terms(rules)
        self.definitions = _definitions(rules, self.junction)
        self.solved = f"the team has made {rules.quota} crossings"

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(IntersectionRules)
        return Appearance(
            legend="Rings are the gates that robots drive to, entries and exits.",
            radius=rules.goal_radius,
            moments=(
                Moment("entry", "enters the crossing", "enter the crossing"),
                Moment("crossing", "leaves the crossing", "leave the crossing"),
            ),
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        layouts[copies] = self.junction.corners
        draw_starts(seeds, copies, self._starts, states)
        start_trips(seeds, copies, self.junction.entries, self._headway, states)

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        serve_trips(
            before.states, now.states, now.seeds, now.times, active, self.junction.entries,
            self.junction.exits, self._rules, now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        half_width = self.junction.half_width
        write_intersection_features(states, active, half_width, self._headway, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        n, dt = self.spec.n_agents, self.spec.control_dt
        robots = robots_of(episode.states, n).astype(np.float64)
        extras = episode.states[:, N_COLUMNS * n :].reshape(-1, n, N_EXTRAS).astype(np.float64)
        is_due = extras[..., WAIT] == 0.0
        speeds = np.hypot(robots[..., VX], robots[..., VY])
        stands = is_due[1:] & (speeds[1:] < STILL_SPEED)
        positions = np.where(is_due[..., None], robots[..., : Y + 1], np.nan)
        crossings = float(extras[-1, :, CROSSINGS].sum())
        return {
            "crossings": crossings,
            "throughput": crossings / (len(episode) * dt / 60.0),
            "waiting_time": float(stands.sum()) * dt / n,
            "deadlocks": float(count_deadlocks(positions, self._starts.radii, dt)),
        }


def _definitions(rules: IntersectionRules, junction: Junction) -> dict[str, str]:
    gates = {
        name: ", ".join(f"({x:.9g}, {y:.9g})" for x, y in places)
        for name, places in (("Entries", junction.entries), ("exits", junction.exits))
    }
    half, stream = junction.half_width, _LAYOUT_STREAM
    return {
        "arm, entry, exit": (
            "Arms 0 to 3 lead to +x, +y, -x and -y. A point is in an arm along x if |x| > |y|, "
            "else along y; its sign says in which. "
            + "; ".join(f"{name} of the arms, m: {places}" for name, places in gates.items())
        ),
        "corner": (
            f"With h = {half:g} m: (x, ty) if |y| > h and |tx| > h; else (tx, y) if |x| > h and "
            "|ty| > h; else (tx, ty). (x, y) is where the robot believes to be"
        ),
        "due": (
            f"Trip q of robot i may begin (q + u) {rules.headway:g} s after the start of the "
            f"episode, u = uniform(derive(seed, {stream}, i, q, 1)). `wait` is what is left of that"
        ),
        "tx, ty": (
            "At first the entry of the arm in which the robot starts. After a step that it ends "
            f"within {rules.goal_radius:g} m of it, when the trip is due, `crossing` turns 1 and "
            "the target is the exit of arm (a + 1 + floor(3 u)) mod 4, a the arm of the entry, u "
            f"= uniform(derive(seed, {stream}, i, q, 0)). After a step that it ends as near to "
            "the exit, `crossing` turns 0, `crossings` rises by 1, and the target is the entry "
            "of the exit's arm"
        ),
        "derive, uniform": f"{DRAW_MEANING}. seed: of the episode, in `episodes/seeds`",
        "deadlocks": (
            f"{DEADLOCK_MEANING}. Robots whose `wait` is above 0, in either state, do not count"
        ),
    }


def _terms(rules: IntersectionRules) -> tuple[Term, ...]:
    w = rules.rewards
    path = (
        "L: |tx - x| + |ty - y|, m, from the robot (x, y) after the step to the target (tx, ty) "
        "that it had before the step; L': the same from where the robot was before the step"
    )
    return (
        Term("progress", w.progress, 1, "(L' - L)", path),
        Term("entry", w.entry, 1, "[entered]", "entered: crossing went from 0 to 1"),
        Term("crossing", w.crossing, 1, "[left]", "left: crossings went up by 1"),
        Term("time", w.time, -1, "1", "1: in every step"),
    )
