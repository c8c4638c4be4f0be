"""Tag: N - 1 pursuers against an evader, all of them robots that policies move.

Roles before the last one are of pursuers; the last one is named `evader` and has one robot.
Pursuers start at rest in one corner, the evader away from them, as in `pursuit`. It is captured
when at least `captors` pursuers are within `capture_radius` of it after the same control step.

Robots see everything. The target of a pursuer is where the evader is, that of the evader is where
it is itself.

State: the robots (`state_layout.ROBOT`).
Action: a command (`dynamics`).
Observation: that of the observation model, and
    is_evader               1 for the evader, else 0
    evader.velocity_x, _y   m/s, of the evader

Reward of pursuer i, with weights w from `spec.rules.rewards`, d' and d its distances to the evader
before and after the step, and [x] one if x holds, else zero:

    w.progress (d' - d) + w.capture [the evader is captured] - w.time

The evader has, in each of these terms, minus the mean of the pursuers' values. So these terms have
the sum zero over the means of both sides. The terms that all tasks share are added (`rewards`).
Solved, by the pursuers: the evader is captured. Otherwise the evader succeeds at the horizon.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from swarmdata.envs.pursuit.pursuit import Pursuit
from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.envs.tag.tag_rules import TagRules
from swarmdata.errors import SpecError
from swarmdata.registry.appearance import Appearance
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature, vector
from swarmdata.specs.rules import Payload
from swarmdata.specs.sensing_models import NoCommunication, StateModel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Episode, Float, Int, Metric, Seeds, Step, Term

EVADER_ROLE = "evader"  # the name of the last role


def pursuit_of(spec: TaskSpec) -> TaskSpec:
    """The task `pursuit` in which the pursuers of a spec chase an evader that the task moves.

    Raises:
        SpecError: the spec is another task's, its team is not that of `tag`, or the evader's speed
            is more than 1,000 times, or less than a thousandth of, that of the pursuers.
    """
    rules, (*pursuers, last) = spec.rules_as(TagRules), spec.team
    if not pursuers or last.name != EVADER_ROLE or last.count != 1:
        roles = ", ".join(f"{role.count} x {role.name}" for role in spec.team)
        raise SpecError(
            f"the team of tag is {roles}, expected roles of pursuers, and then 1 x {EVADER_ROLE}. "
            "Start from the preset tag."
        )
    top = max(role.robot.max_speed for role in pursuers)
    fields = {
        "captors": rules.captors,
        "capture_radius": rules.capture_radius,
        "speed_ratio": last.robot.max_speed / top,
        "evader_radius": last.robot.radius,
        "start_size": rules.start_size,
    }
    pursuit = PursuitRules.parse(fields, "the team of tag")
    return spec.with_updates(
        rules=pursuit,
        team=pursuers,
        observation=StateModel(),
        communication=NoCommunication(),
        randomization={},
    )


@kernel
def score_tags(
    before: Float,  # [E, S] states before the step
    after: Float,  # states after the step; targets are updated
    active: Bool,  # [E]
    capture_radius: float,  # m
    captors: int,  # pursuers that capture
    terms: Float,  # [E, N, R] progress, capture and time are written
    solved: Bool,  # [E] written
) -> None:
    """Captures evaders in the active copies, sets targets, and scores the step."""
    last = terms.shape[1] - 1
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        old, new, e, n_near, total = before[b], after[b], N_COLUMNS * last, 0, 0.0
        for i in range(last + 1):
            r = N_COLUMNS * i
            new[r + TX], new[r + TY] = new[e], new[e + 1]
            if i == last:
                continue
            was_x, was_y = np.float64(old[r]) - old[e], np.float64(old[r + 1]) - old[e + 1]
            x, y = np.float64(new[r]) - new[e], np.float64(new[r + 1]) - new[e + 1]
            distance = np.sqrt(x * x + y * y)
            n_near += distance <= capture_radius
            terms[b, i, 0] = np.sqrt(was_x * was_x + was_y * was_y) - distance
            total += terms[b, i, 0]
        is_captured = n_near >= captors
        for i in range(last + 1):
            sign = 1.0 if i < last else -1.0
            terms[b, i, 1], terms[b, i, 2] = sign * is_captured, sign
        terms[b, last, 0] = -total / last
        solved[b] = is_captured


@kernel
def write_tag_features(states: Float, active: Bool, out: Float) -> None:
    """Writes the task's features of every robot in the active copies, [E, N, 3]."""
    last = out.shape[1] - 1
    for b in range(states.shape[0]):
        if not active[b]:
            continue
        state, e = states[b], N_COLUMNS * last
        for i in range(last + 1):
            out[b, i, 0] = 1.0 if i == last else 0.0
            out[b, i, 1], out[b, i, 2] = state[e + VX], state[e + VY]


class Tag:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "tightest_ring": Metric(
            "tightest ring",
            "m",
            "neither",
            "smallest radius around the evader that ever held as many pursuers as capture it",
        )
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules, self._pursuit = spec.rules_as(TagRules), Pursuit(pursuit_of(spec))
        self.spec = spec
        self.kinds: Int = self._pursuit.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras: tuple[Column, ...] = ()
        self.features = (
            Feature("is_evader", "flag", "", "1 for the evader, else 0"),
            *vector("evader.velocity", "velocity", "velocity of the evader"),
        )
        self._rules, self.terms = rules, _terms(rules)
        self.solved = (
            f"{rules.captors} pursuers are within {rules.capture_radius:g} m of the evader"
        )

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(TagRules)
        return Appearance(
            legend=(
                f"Robot {spec.n_agents - 1} is the evader. The rings are around it: it is captured "
                f"with {rules.captors} centers of pursuers inside."
            ),
            radius=rules.capture_radius,
        )

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        """Draws the episodes that the pursuers have in `pursuit`, with a robot for the evader."""
        columns, n = self._pursuit.columns, self.spec.n_agents - 1
        drawn = np.zeros((len(states), columns.headings + 2), dtype=np.float32)
        self._pursuit.spawn(seeds, copies, layouts, drawn)
        rows = drawn[copies]
        evader: Float = np.zeros((len(copies), N_COLUMNS), dtype=np.float32)
        evader[:, X : Y + 1] = evader[:, TX : TY + 1] = rows[:, columns.places : columns.captured]
        evader[:, UX] = 1.0
        if self.spec.robots[n].dynamics == "unicycle":
            evader[:, UX : UY + 1] = rows[:, columns.headings : columns.headings + 2]
        states[copies] = np.concatenate([rows[:, : columns.places], evader], axis=1)

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        score_tags(
            before.states, now.states, active, self._rules.capture_radius, self._rules.captors,
            now.reward_terms, solved,
        )  # fmt: skip

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        write_tag_features(states, active, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        places = robots_of(episode.states, self.spec.n_agents)[..., : Y + 1].astype(np.float64)
        gaps = np.linalg.norm(places[:, :-1] - places[:, -1:], axis=-1)  # [T + 1, P]
        reach = np.sort(gaps, axis=1)[:, self._rules.captors - 1]
        return {"tightest_ring": float(reach.min())}


def _terms(rules: TagRules) -> tuple[Term, ...]:
    w, evader = rules.rewards, "of the evader minus the mean of the pursuers' values"
    way = (
        "advance: of a pursuer d' - d, where d is its distance, m, from the evader after the step, "
        f"and d' the same before the step; {evader}"
    )
    captured = (
        f"captured: of a pursuer 1 if the evader is captured after the step, else 0; {evader}"
    )
    return (
        Term("progress", w.progress, 1, "advance", way),
        Term("capture", w.capture, 1, "captured", captured),
        Term("time", w.time, -1, "step", f"step: of a pursuer 1; {evader}"),
    )
