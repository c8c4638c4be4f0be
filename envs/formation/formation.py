"""Formation: N robots reach and hold a shape while its reference moves through an arena.

The reference is the centre of the slots. It drives along a smooth path (`reference_path`) and faces
in its direction of motion. The path is clear, but slots meet obstacles: the formation must bend
around them and re-form (`formation_spawn` lists what holds in every episode). Slots are rigid in
the reference's frame (`shapes`): p + R(heading) offset. A slot's velocity is v + w x (slot - p),
with the reference's position p, velocity v and turn rate w.

State: the robots (`state_layout.ROBOT`); a robot's target is its slot in this step. With
`slots: fixed`, robot i has slot i; with `slots: assigned`, every step assigns the slots anew with
the least sum of squared distances. Then the reference: x, y (m), vx, vy (m/s), heading ux, uy,
turn_rate (rad/s); steps_held, the number of steps in formation so far; for each time in `preview`
the reference's position and heading at that time; and the path's control points x, y (m).
Action: a command (`dynamics`).
Observation: that of the observation model, which includes the robot's slot, and, in the world's
frame:

    reference.offset    from the robot to the reference, m
    reference.velocity  m/s
    reference.heading   unit vector
    slot.velocity       of the robot's slot, minus the robot's own, m/s
    preview_k.offset    from the robot to where its slot will be after preview[k] seconds, m

Own reward of robot i, with weights w from `spec.rules.rewards`, d its distance to its slot and dv
the difference between its velocity and its slot's, both after the step:

    - w.deviation min(d, 1) - (w.time if d > tolerance else w.velocity dv)

Velocities count only inside the slot, so that a robot may hurry to it. The terms that all tasks
share are added (`rewards`).

The team is in formation in a step if the root mean square of d over robots is at most `tolerance`.
Solved: in formation for `hold_fraction` of the horizon's steps in total, consecutive or not. The
episode ends there and not at the horizon, so that forming up fast and rarely losing the shape ends
it early, the bonus comes when it is earned, and long episodes contain the hard parts.

Metrics: `formation_rmse`, `time_in_formation`, `reference_error`; see `Formation.metrics`.
"""

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.envs.formation.formation_spawn import draw_episodes, plan_episodes
from swarmdata.envs.formation.shapes import check_slots, slot_offsets
from swarmdata.envs.formation.slots import (
    HELD,
    PREVIEW,
    Course,
    Scratch,
    begin_episodes,
    place_reference,
    slot_velocity,
)
from swarmdata.numerics.assignment import assignment_work
from swarmdata.registry.appearance import Appearance
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, telling_goals, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, VX, VY, X, Y, pair, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Episode, Float, Int, Metric, Seeds, Step, Term


@kernel
def score_formation(state: Float, tolerance: float, terms: Float) -> bool:
    """Writes the task's own terms of one copy, [N, R]; returns whether it is in formation.

    `state`: after the step, [S]. `tolerance`: m.
    """
    n, total = terms.shape[0], 0.0
    for i in range(n):
        r = N_COLUMNS * i
        dx = float(state[r + TX]) - float(state[r + X])
        dy = float(state[r + TY]) - float(state[r + Y])
        square = dx * dx + dy * dy
        d = math.sqrt(square)
        total += square
        terms[i, 0], terms[i, 1], terms[i, 2] = min(d, 1.0), 1.0, 0.0
        if d <= tolerance:
            vx, vy = slot_velocity(state, n, i)
            vx, vy = vx - float(state[r + VX]), vy - float(state[r + VY])
            terms[i, 1], terms[i, 2] = 0.0, math.sqrt(vx * vx + vy * vy)
    return total <= n * tolerance * tolerance


@kernel
def advance(
    states: Float,  # [E, S] robots are those after the step; targets and extras are written
    times: Int,  # [E] control steps taken
    active: Bool,  # [E]
    course: Course,  # of the spec
    rule: tuple[float, int],  # tolerance, m, and steps in formation that solve the task
    scratch: Scratch,  # overwritten
    terms: Float,  # [E, N, R] deviation, time and velocity are written
    solved: Bool,  # [E] written
) -> None:
    """Completes the states of the active copies and scores them.

    `rule` is a plain tuple, since named ones are slower to pass.
    """
    tolerance, needed = rule
    held = N_COLUMNS * course[0].shape[0] + HELD
    for b in range(states.shape[0]):
        if active[b]:
            place_reference(states[b], times[b], course, scratch)
            if score_formation(states[b], tolerance, terms[b]):
                states[b, held] += np.float32(1.0)
            solved[b] = states[b, held] >= needed


@kernel
def write_formation_features(states: Float, active: Bool, n: int, out: Float) -> None:
    """Writes 8 features of every robot in active copies, and 2 for each preview, [E, N, F].

    `states` are [E, S], `active` [E].
    """
    n_previews = (out.shape[2] - 8) // 2
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        extras = states[b, N_COLUMNS * n :]
        ux, uy = float(extras[4]), float(extras[5])
        for i in range(n):
            robot, row = states[b, N_COLUMNS * i :], out[b, i]
            px, py = float(robot[X]), float(robot[Y])
            row[0], row[1] = float(extras[0]) - px, float(extras[1]) - py
            for c in range(4):
                row[2 + c] = extras[2 + c]
            vx, vy = slot_velocity(states[b], n, i)
            row[6], row[7] = vx - float(robot[VX]), vy - float(robot[VY])
            dx, dy = float(robot[TX]) - float(extras[0]), float(robot[TY]) - float(extras[1])
            lx, ly = dx * ux + dy * uy, dy * ux - dx * uy  # the slot in the reference's frame
            for k in range(n_previews):
                pose = extras[PREVIEW + 4 * k :]
                wx, wy = float(pose[2]), float(pose[3])
                row[8 + 2 * k] = float(pose[0]) + wx * lx - wy * ly - px
                row[9 + 2 * k] = float(pose[1]) + wy * lx + wx * ly - py


class Formation:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "formation_rmse": Metric(
            "formation RMSE",
            "m",
            "lower",
            "root mean square distance of robots to their slots, mean over steps",
        ),
        "time_in_formation": Metric(
            "time in formation", "", "higher", "share of steps with an RMSE within the tolerance"
        ),
        "reference_error": Metric(
            "reference error",
            "m",
            "lower",
            "distance of the robots' centroid from the reference, mean over steps",
        ),
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules, n = spec.rules_as(FormationRules), spec.n_agents
        self.spec = spec
        check_slots(rules, np.array([robot.radius for robot in spec.robots]))
        offsets = slot_offsets(rules, n)
        self._plan = plan_episodes(spec, rules, offsets)
        self.kinds: Int = self._plan.spawn.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras = _extras(rules.preview, self._plan.path.n_points, spec)
        self.features: tuple[Feature, ...] = _features(rules.preview)
        self.segment_rate = rate = self._plan.path.rate  # segments of the path per second
        ahead = np.array(rules.preview, dtype=np.float64) * rate
        is_assigned = rules.slots == "assigned"
        self._course: Course = (offsets, is_assigned, spec.control_dt * rate, rate, ahead)
        self._scratch = (np.zeros((n, 2)), np.zeros((n, n)), *assignment_work(n))
        needed = max(1, math.ceil(rules.hold_fraction * spec.horizon - 1e-9))
        self._rule = (rules.tolerance, needed)
        self._tolerance = rules.tolerance
        self.terms = _terms(rules)
        self.solved = (
            f"the root mean square of the robots' distances to their slots (tx, ty) was at most "
            f"{rules.tolerance:g} m in {needed} steps of the episode, consecutive or not"
        )

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(FormationRules)
        return Appearance(
            legend="Crosses are the robots' slots, discs slots that are held.",
            mark="slot",
            radius=rules.tolerance,
            is_linked=True,
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        draw_episodes(self._plan, seeds, copies, layouts, states)
        begin_episodes(copies, states, self._course, self._scratch)

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        advance(
            now.states, now.times, active, self._course, self._rule, self._scratch,
            now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        write_formation_features(states, active, self.spec.n_agents, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        n = self.spec.n_agents
        centre = episode.states[1:, N_COLUMNS * n : N_COLUMNS * n + 2].astype(np.float64)
        robots = robots_of(episode.states[1:], n).astype(np.float64)
        offsets = robots[..., [TX, TY]] - robots[..., [X, Y]]
        squares = (offsets * offsets).sum(axis=(1, 2))
        away = robots[..., [X, Y]].mean(axis=1) - centre
        is_formed = squares <= n * self._tolerance * self._tolerance
        return {
            "formation_rmse": float(np.sqrt(squares / n).mean()),
            "time_in_formation": float(is_formed.mean()),
            "reference_error": float(np.sqrt((away * away).sum(axis=1)).mean()),
        }


def _extras(previews: tuple[float, ...], n_points: int, spec: TaskSpec) -> tuple[Column, ...]:
    rules, half = spec.rules_as(FormationRules), spec.half_size
    spline = (
        "of the reference's path, a uniform cubic B-spline whose segments take "
        f"{rules.segment_time:g} s each; constant in an episode"
    )
    held = "steps of the episode so far, this one included, in which the team was in formation"
    return (
        *pair("reference_", "position of the reference, the origin of the slots", "m", half),
        *pair("reference_v", "velocity of the reference", "m/s", None),
        *pair("reference_u", "heading of the reference", "", (1.0, 1.0), "; a unit vector"),
        Column("reference_turn_rate", "turn rate of its heading, counter-clockwise", "rad/s"),
        Column("steps_held", held, low=0, high=spec.horizon),
        *(
            column
            for k, seconds in enumerate(previews)
            for column in (
                *pair(f"preview_{k}_", f"position of the reference {seconds:g} s later", "m", half),
                *pair(
                    f"preview_{k}_u",
                    f"heading of the reference {seconds:g} s later",
                    "",
                    (1.0, 1.0),
                ),
            )
        ),
        *(
            column
            for k in range(n_points)
            for column in pair(f"control_{k}_", f"control point {k} {spline}", "m", half)
        ),
    )


def _terms(rules: FormationRules) -> tuple[Term, ...]:
    w, tolerance = rules.rewards, rules.tolerance
    distance = "d: distance, m, from the robot (x, y) to its slot (tx, ty) after the step"
    velocity = (
        "dv: magnitude, m/s, of the difference between the robot's velocity (vx, vy) and that of "
        "its slot after the step. The slot has the velocity (reference_vx - r (ty - reference_y), "
        "reference_vy + r (tx - reference_x)) with r = reference_turn_rate"
    )
    return (
        Term("deviation", w.deviation, -1, "min(d, 1)", distance),
        Term("time", w.time, -1, f"[d > {tolerance:g}]", distance),
        Term("velocity", w.velocity, -1, f"dv * [d <= {tolerance:g}]", velocity),
    )


def _features(previews: tuple[float, ...]) -> tuple[Feature, ...]:
    later = (
        vector(f"preview_{k}.offset", "position", f"own slot in {seconds:g} s - own position")
        for k, seconds in enumerate(previews)
    )
    return (
        *vector("reference.offset", "position", "reference - own position"),
        *vector("reference.velocity", "velocity", "of the reference"),
        *vector("reference.heading", "direction", "of the reference, its direction of motion"),
        *telling_goals(vector("slot.velocity", "velocity", "own slot's velocity - own velocity")),
        *telling_goals(feature for pair in later for feature in pair),
    )
