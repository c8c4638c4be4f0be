"""Transport: robots push a payload that none can move alone to a goal.

A payload lies on the floor, whose dry friction (`Payload.friction`, N) holds it. A robot of mass
1 kg pushes with at most its `max_acceleration`, by default 1.5 N against a friction of 2.5 N. So
one robot cannot move the payload (a run-up moves it 2 cm), and two can. Robots cannot grip or pull:
a payload at a wall comes off only by being pushed along it. Contacts with the payload are no
collisions.

State: the robots (`state_layout.ROBOT`); a robot's target is the goal of the payload's centre (m),
the same for all robots in every step. Then the payload (`state_layout.BODY`). With `goal_angle`,
then the wanted direction of its local x axis, a unit vector (`goal_ux`, `goal_uy`).

Action: a command (`dynamics`).

Observation: that of the observation model, then, in the world's frame, all relative to the robot
or the payload:

    payload_x, _y             payload's centre minus the robot's, m
    payload_near_x, _y        the payload's nearest point minus the robot's centre, m
    payload_velocity_x, _y    velocity of the payload, m/s
    payload_goal_x, _y        goal minus the payload's centre, m
    payload_obstacle_<k>.near_x, _y direction from the payload's centre to the nearest point of the
                              obstacle nearest to it (k = 0) and of the next (1), times closeness:
                              0 from `SURROUNDINGS_RANGE` beyond its bounding circle on, 1 in
                              contact
    payload_axis_x, _y        direction of its local x axis, a unit vector (a box only)
    payload_turn              turn rate times the distance of a corner, m/s (a box only)
    goal_axis_x, _y           wanted direction of that axis (with `goal_angle` only)

A box looks the same after half a turn, so its axis has two directions. The one given makes an angle
of at most 90 degrees with `goal_axis` or, without a goal angle, with the direction to the goal.

Own reward of robot i, with weights w from `spec.rules.rewards`, before (') and after the step: d
the distance of the payload's centre to its goal, g_i the distance of the robot's centre to the
payload's nearest point, s the sine of the angle between the payload's axis and the wanted one (0
without `goal_angle`), and [x] one if x holds, else zero:

    w.progress (d' - d) + w.turn_progress (s' - s) + w.approach (g_i' - g_i) - w.time [not solved]

The first three terms are differences of potentials: going back and forth earns nothing, and their
sum over an episode is bounded by its initial state. The terms that all tasks share are added
(`rewards`). Solved: the payload's centre is within `goal_radius` of its goal and, with
`goal_angle`, its axis within that angle of the wanted one.

Episodes: obstacles keep `obstacles.gap` from each other and from the walls, a gap in which the
payload must fit in any direction. The payload starts with `room` around it, so that robots can get
behind it, and its goal keeps `spawn.goal_clearance`. A box turns by Munk2D's own sine and cosine,
so the last bits of its episodes depend on the C library; those of a circle do not.

Metrics: see `Transport.metrics`.
"""

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from swarmdata.envs.transport.payload import (
    Shape,
    count_contacts,
    count_pushes,
    payload_radius,
    place_row,
    shape_of,
)
from swarmdata.envs.transport.transport_rules import TransportRules
from swarmdata.envs.world.spawn import (
    Spacing,
    SpawnPlan,
    direction_of,
    place_obstacles,
    place_points,
    put_at_rest,
)
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import BOX, CIRCLE, nearest, nearest_of
from swarmdata.numerics.random import STREAMS
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.registry.appearance import Appearance
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, numbered, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import BODY, N_COLUMNS, TX, TY, UX, UY, X, Y, pair, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Episode, Float, Int, Metric, Seeds, Step, Term

N_NEAR_OBSTACLES = 2  # number of obstacles around the payload that robots observe
SURROUNDINGS_RANGE = 1.5  # m from the payload's bounding circle within which obstacles are observed
ANY_ANGLE_SINE = 2.0  # above the sine of any angle, for goals without one


_LAYOUT_STREAM = STREAMS["layout"]


@kernel
def _draw_direction(bits: np.uint64, out: Float) -> None:
    out[0], out[1] = direction_of(to_uniform(absorb(bits, 0)), to_uniform(absorb(bits, 1)))


@kernel
def _place(
    state: Seeds,  # [1] of the generator
    plan: SpawnPlan,  # of the spec
    radius: Double,  # [1] of the payload's bounding circle, m
    room: float,  # free distance around the payload's start, m
    layout: Float,  # [M, 8] written
    robots: Float,  # [N, 8] written, columns `state_layout.ROBOT`
    body: Float,  # [7] written
) -> bool:
    """Draws obstacles, payload and goal, then the robots; False if one found no place."""
    if not place_obstacles(state, plan.sizes, plan.half, plan.obstacle_gap, layout):
        return False
    start, goal = np.zeros((1, 2), np.float32), np.zeros((1, 2), np.float32)
    at_start, at_goal = Spacing(room, 0.0), Spacing(plan.goals.clearance, 0.0)
    if not place_points(state, layout, plan.half, radius, at_start, start, start, 0.0):
        return False
    away = plan.min_goal_distance
    if not place_points(state, layout, plan.half, radius, at_goal, goal, start, away):
        return False
    body[0], body[1] = start[0, 0], start[0, 1]
    for i in range(plan.radii.shape[0]):
        robots[i, TX], robots[i, TY] = goal[0, 0], goal[0, 1]
    around = np.zeros((layout.shape[0] + 1, 8), np.float32)  # robots must not overlap the payload
    for m in range(layout.shape[0]):
        for c in range(8):
            around[m, c] = layout[m, c]
    around[-1, 0], around[-1, 1], around[-1, 2] = CIRCLE, body[0], body[1]
    around[-1, 5] = around[-1, 6] = radius[0]
    starts = robots[:, X : Y + 1]
    return place_points(state, around, plan.half, plan.radii, plan.starts, starts, starts, 0.0)


@kernel
def draw_episodes(
    seeds: Seeds,  # [len(copies)] episode seeds
    copies: Int,  # rows to write
    plan: SpawnPlan,  # of the spec
    payload_radius: float,  # of its bounding circle, m
    room: float,  # free distance around the payload's start, m
    layouts: Float,  # [E, M, 8] written
    states: Float,  # [E, S] written
) -> int:
    """Draws the episodes `seeds` into `copies`; returns how many were drawn before one failed."""
    n = plan.radii.shape[0]
    first = N_COLUMNS * n
    generator, radius = np.empty(1, np.uint64), np.full(1, payload_radius)
    for k in range(copies.shape[0]):
        state, layout = states[copies[k]], layouts[copies[k]]
        robots, body = state[:first].reshape(n, N_COLUMNS), state[first : first + len(BODY)]
        key = absorb(seeds[k], _LAYOUT_STREAM)
        generator[0] = key
        for attempt in range(plan.max_attempts + 1):
            if attempt == plan.max_attempts:
                return k
            if _place(generator, plan, radius, room, layout, robots, body):
                break
        for i in range(n):
            put_at_rest(generator, False, robots[i])
            if plan.has_heading[i]:
                _draw_direction(absorb(key, 2 + i), robots[i, UX : UY + 1])
        body[2] = body[3] = body[6] = 0.0
        _draw_direction(absorb(key, 0), body[4:6])
        if state.shape[0] > first + len(BODY):
            _draw_direction(absorb(key, 1), state[first + len(BODY) :])
    return copies.shape[0]


@kernel(inline="always")
def goal_error(state: Float, first: int) -> tuple[float, float]:
    """Distance from the payload's centre to its goal (m), and sine of the angle between their axes.

    `state`: [S]. `first`: index of the payload's first column.
    """
    dx = np.float64(state[TX]) - np.float64(state[first])
    dy = np.float64(state[TY]) - np.float64(state[first + 1])
    sine = 0.0
    if state.shape[0] > first + 7:
        ux, uy = np.float64(state[first + 4]), np.float64(state[first + 5])
        sine = abs(ux * np.float64(state[first + 8]) - uy * np.float64(state[first + 7]))
    return math.sqrt(dx * dx + dy * dy), sine


@kernel
def score_transport(
    before: Float,  # [E, S] states before the step
    after: Float,  # [E, S] states after the step
    active: Bool,  # [E]
    shape: Shape,  # of the payload
    goal: tuple[float, float],  # radius, m, and largest sine of the angle
    terms: Float,  # [E, N, R] progress, turn progress, approach and time are written
    solved: Bool,  # [E] written
) -> None:
    """Writes the task's own terms of the active copies, and whether they have solved the task."""
    goal_radius, max_sine = goal
    n = terms.shape[1]
    first = N_COLUMNS * n
    old, new = np.empty(8, np.float32), np.empty(8, np.float32)
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old_d, old_s = goal_error(before[b], first)
        d, s = goal_error(after[b], first)
        solved[b] = d <= goal_radius and s <= max_sine
        place_row(before[b, first:], shape, old)
        place_row(after[b, first:], shape, new)
        for i in range(n):
            x, y = before[b, N_COLUMNS * i], before[b, N_COLUMNS * i + 1]
            gap = nearest(np.float64(x), np.float64(y), old)[0]
            x, y = after[b, N_COLUMNS * i], after[b, N_COLUMNS * i + 1]
            gap -= nearest(np.float64(x), np.float64(y), new)[0]
            terms[b, i, 0], terms[b, i, 1], terms[b, i, 2] = old_d - d, old_s - s, gap
            terms[b, i, 3] = 0.0 if solved[b] else 1.0


@kernel(error_model="numpy")
def write_surroundings(x: float, y: float, radius: float, layout: Float, out: Double) -> None:
    """Writes closeness vectors of obstacles around a payload, nearest first, [N_NEAR_OBSTACLES, 2].

    `x`, `y`: its centre, m. `radius`: of its bounding circle, m. `layout`: obstacles, [M, 8].
    """
    distances = np.full(N_NEAR_OBSTACLES, np.inf)
    out[:] = 0.0
    for m in range(layout.shape[0]):
        distance, vx, vy = nearest_of(x, y, layout, m)
        slot = N_NEAR_OBSTACLES
        while slot > 0 and distance < distances[slot - 1]:
            slot -= 1
            if slot + 1 < N_NEAR_OBSTACLES:
                distances[slot + 1] = distances[slot]
                out[slot + 1, 0], out[slot + 1, 1] = out[slot, 0], out[slot, 1]
        if slot < N_NEAR_OBSTACLES:
            closeness = min(max(1.0 - (distance - radius) / SURROUNDINGS_RANGE, 0.0), 1.0)
            scale = closeness / max(distance, 1e-9)
            distances[slot] = distance
            out[slot, 0], out[slot, 1] = vx * scale, vy * scale


@kernel
def write_transport_features(
    states: Float, layouts: Float, active: Bool, shape: Shape, out: Float
) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, F]."""
    kind, half_length, half_width = shape
    n, is_box = out.shape[1], kind == BOX
    first = N_COLUMNS * n
    arm = math.sqrt(half_length * half_length + half_width * half_width)
    radius = arm if is_box else half_length
    row, around = np.empty(8, np.float32), np.empty((N_NEAR_OBSTACLES, 2))
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state, body = states[b], states[b, first:]
        place_row(body, shape, row)
        write_surroundings(np.float64(body[0]), np.float64(body[1]), radius, layouts[b], around)
        gx = np.float64(state[TX]) - np.float64(body[0])
        gy = np.float64(state[TY]) - np.float64(body[1])
        is_posed = body.shape[0] > 7
        wx, wy = (np.float64(body[7]), np.float64(body[8])) if is_posed else (gx, gy)
        ux, uy = np.float64(body[4]), np.float64(body[5])
        sign = 1.0 if ux * wx + uy * wy >= 0.0 else -1.0
        for i in range(n):
            x, y = np.float64(state[N_COLUMNS * i]), np.float64(state[N_COLUMNS * i + 1])
            features = out[b, i]
            features[0], features[1] = np.float64(body[0]) - x, np.float64(body[1]) - y
            _, features[2], features[3] = nearest(x, y, row)
            features[4], features[5] = body[2], body[3]
            features[6], features[7] = gx, gy
            for k in range(N_NEAR_OBSTACLES):
                features[8 + 2 * k], features[9 + 2 * k] = around[k, 0], around[k, 1]
            at = 8 + 2 * N_NEAR_OBSTACLES
            if is_box:
                features[at], features[at + 1] = sign * ux, sign * uy
                features[at + 2] = np.float64(body[6]) * arm
            if is_posed:
                features[at + 3], features[at + 4] = wx, wy


class Transport:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "payload_distance": Metric(
            "payload to goal", "m", "lower", "distance of the payload to its goal at the end"
        ),
        "payload_path": Metric("payload path", "m", "neither", "length of the payload's path"),
        "payload_contacts": Metric(
            "payload contacts", "", "lower", "contacts of the payload with obstacles and walls"
        ),
        "push_share": Metric(
            "pushing", "", "neither", "share of robot steps in contact with the payload"
        ),
        "payload_angle": Metric(
            "payload angle",
            "rad",
            "lower",
            "angle of the payload's axis to its goal's at the end; 0 where any will do",
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(TransportRules)
        radius = payload_radius(rules.payload)
        if spec.obstacles.gap < 2.0 * radius:
            raise SpecError(
                f"obstacles.gap is {spec.obstacles.gap:g} m, and the payload needs "
                f"{2.0 * radius:.2f} m to pass in any direction. Make the gap wider or the payload "
                "smaller."
            )
        self.spec = spec
        self._plan = SpawnPlan.of(spec)
        self.kinds: Int = self._plan.kinds
        self.movables: tuple[Payload, ...] = (rules.payload,)
        is_posed, is_box = rules.goal_angle is not None, rules.payload.shape == "box"
        wanted = "wanted direction of the payload's local x axis; the opposite will do too"
        self.extras = pair("goal_u", wanted, "", (1.0, 1.0)) if is_posed else ()
        self.terms, self.solved = _terms(rules), _solved(rules)
        self.features = _features(is_box, is_posed)
        self._shape = shape_of(rules.payload)
        # rounded, so that it does not depend on the C library's sine
        sine = ANY_ANGLE_SINE if rules.goal_angle is None else round(math.sin(rules.goal_angle), 9)
        self._goal = (rules.goal_radius, sine)
        self._radius, self._room = radius, rules.room

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(TransportRules)
        return Appearance(
            legend="The dashed outline is where the payload should be.",
            mark="pose",
            radius=rules.goal_radius,
            direction=None if rules.goal_angle is None else 0,
            bodies=(rules.payload,),
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        plan, radius, room = self._plan, self._radius, self._room
        drawn = draw_episodes(seeds, copies, plan, radius, room, layouts, states)
        if drawn < len(copies):
            raise SpawnError(
                f"no layout found for seed {seeds[drawn]} in {plan.max_attempts} attempts: the "
                f"payload needs {radius + room:.2f} m around its start, obstacles gaps of "
                f"{plan.obstacle_gap:g} m. Use fewer or smaller obstacles, or a larger arena."
            )

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        score_transport(
            before.states, now.states, active, self._shape, self._goal, now.reward_terms, solved
        )

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        write_transport_features(states, layouts, active, self._shape, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        n, first = self.spec.n_agents, N_COLUMNS * self.spec.n_agents
        bodies = np.ascontiguousarray(episode.states[:, first : first + len(BODY)])
        positions = np.ascontiguousarray(robots_of(episode.states[1:], n)[..., : Y + 1])
        distance, sine = goal_error(episode.states[-1], first)
        pushes = count_pushes(positions, self._plan.radii, bodies[1:], self._shape)
        steps = np.diff(bodies[:, :2].astype(np.float64), axis=0)
        return {
            "payload_distance": distance,
            "payload_path": float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
            "payload_contacts": float(
                count_contacts(bodies, self._shape, episode.layout, self._plan.half)
            ),
            "push_share": pushes / (n * len(episode)),
            "payload_angle": math.asin(min(sine, 1.0)),
        }


def _terms(rules: TransportRules) -> tuple[Term, ...]:
    w = rules.rewards
    distance = "d: distance, m, from the payload's centre to the target (tx, ty) after the step"
    sine = (
        "s: |sine| of the angle between the payload's axis (ux, uy) and (goal_ux, goal_uy) after "
        "the step; s': before it"
        if rules.goal_angle is not None
        else "s: 0, since any direction of the payload will do; s': the same"
    )
    size = f"{rules.payload.half_length:g}"
    body = (
        f"a disc of radius {size} m"
        if rules.payload.shape == "circle"
        else f"the rectangle |x| <= {size}, |y| <= {rules.payload.half_width:g} m in its frame"
    )
    gap = (
        "g: distance, m, from the robot's centre to the payload's nearest point after the step; "
        f"g': before it. The payload is {body}"
    )
    return (
        Term("progress", w.progress, 1, "(d' - d)", f"{distance}; d': before it"),
        Term("turn_progress", w.turn_progress, 1, "(s' - s)", sine),
        Term("approach", w.approach, 1, "(g' - g)", gap),
        Term("time", w.time, -1, "[not solved]", "solved: as for success"),
    )


def _solved(rules: TransportRules) -> str:
    near = f"the payload's centre is within {rules.goal_radius:g} m of the target"
    if rules.goal_angle is None:
        return near
    return f"{near}, and its axis within {rules.goal_angle:g} rad of the wanted one or its opposite"


def _features(is_box: bool, is_posed: bool) -> tuple[Feature, ...]:
    meaning = "from the payload to an obstacle's nearest point, times closeness"
    near = vector("near", "direction", meaning)
    found: tuple[Feature, ...] = (
        *vector("payload", "position", "payload's centre minus own position"),
        *vector("payload_near", "position", "payload's nearest point minus own position"),
        *vector("payload_velocity", "velocity", "velocity of the payload"),
        *telling_goals(vector("payload_goal", "position", "goal minus the payload's centre")),
        *numbered("payload_obstacle", N_NEAR_OBSTACLES, near),
    )
    if is_box:
        turn = Feature("payload_turn", "velocity", meaning="turn rate times distance of a corner")
        axis = vector("payload_axis", "direction", "direction of its local x axis")
        found += (*telling_goals(axis), turn)  # it is the direction that is nearer to the goal's
    if is_posed:
        found += telling_goals(vector("goal_axis", "direction", "wanted direction of that axis"))
    return found
