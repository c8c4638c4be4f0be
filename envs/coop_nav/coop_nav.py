"""Cooperative navigation: N robots drive to goals among obstacles and each other.

State: the robots (`state_layout.ROBOT`). With `goals: assigned`, robot i's target is its goal for
the whole episode. With `goals: unassigned`, the N goals belong to nobody and follow the robots as
`goal_0_x`, `goal_0_y`, ... (m); robot i's target is then the nearest of the goals that it covers
itself or that no robot covers (the first of several at equal distance).
Action: a command (`dynamics`).
Observation: that of the observation model, which includes the target. Unassigned goals add all
goals to it, nearest first: `goal_k.offset` (m, goal minus own position) and `goal_k.is_taken` (1 if
another robot covers the goal; if several do, the first counts).

A robot has reached its goal, and covers a goal, if it is at most `goal_radius` away from it. Goals
are more than two radii apart, so a robot covers at most one.

Own reward of robot i, with weights w from `spec.rules.rewards`, d' and d its distance to its goal
before and after the step, and [x] one if x holds, else zero:

    assigned:    w.progress (d' - d) - w.time [d > goal_radius]
    unassigned:  (w.progress (D' - D) - w.time * goals not covered) / N,  the same for all robots

D is the smallest possible sum of distances from robots to goals, over all assignments. So in both
cases the sum over the team is w.progress times the decrease of the distance left to drive, minus
w.time for each goal that is not reached. The terms that all tasks share are added (`rewards`).

Solved: all robots have reached their goals at the same time, or all goals are covered.
Metric: `reached_fraction`, the share of goals reached or covered in the last state.

Layouts: `arrangement: {kind: random}` draws obstacles, starts and goals (`spawn`); the other
arrangements are fixed hard layouts (`arrangements`).
"""

import math
from collections.abc import Mapping
from itertools import chain
from typing import ClassVar

import numpy as np

from swarmdata.envs.coop_nav.arrangements import arrange
from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.envs.coop_nav.unassigned_goals import (
    goal_features,
    score_coverage,
    share_goals,
    write_goal_features,
)
from swarmdata.envs.world.spawn import SpawnPlan, spawn_random
from swarmdata.errors import SpecError
from swarmdata.numerics.assignment import assignment_work
from swarmdata.registry.appearance import Appearance, SharedTargets
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, pair, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Episode, Float, Int, Metric, Seeds, Step, Term


@kernel
def score_navigation(
    before: Float, after: Float, active: Bool, goal_radius: float, terms: Float, solved: Bool
) -> None:
    """Writes the task's own terms of the active copies, and whether all robots are at goals."""
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        everyone = True
        for i in range(terms.shape[1]):
            old = _goal_distance(before[b], i)
            new = _goal_distance(after[b], i)
            outside = new > goal_radius
            everyone = everyone and not outside
            terms[b, i, 0] = old - new
            terms[b, i, 1] = 1.0 if outside else 0.0
        solved[b] = everyone


@kernel(inline="always")
def _goal_distance(state: Float, i: int) -> float:
    r = N_COLUMNS * i
    dx = float(state[r + TX]) - float(state[r])
    dy = float(state[r + TY]) - float(state[r + 1])
    return math.sqrt(dx * dx + dy * dy)


class CoopNav:
    """Implements `interfaces.Task`; raises a `SpecError` if the spec contradicts itself."""

    metrics: ClassVar[Mapping[str, Metric]] = {
        "reached_fraction": Metric(
            "goals reached", "", "higher", "share of goals reached or covered in the last state"
        )
    }

    def __init__(self, spec: TaskSpec) -> None:
        rules, n = spec.rules_as(NavigationRules), spec.n_agents
        self.spec = spec
        self._plan = SpawnPlan.of(spec)
        self._layout, self._place = arrange(spec)
        self.kinds: Int = self._plan.kinds
        if self._layout is not None:
            self.kinds = self._layout[:, 0].astype(np.int64)
        self.movables: tuple[Payload, ...] = ()
        self.extras: tuple[Column, ...] = ()
        self.features: tuple[Feature, ...] = ()
        self._is_shared = rules.goals == "unassigned"
        if self._is_shared:
            _check_separation(spec, rules.goal_radius)
            pairs = (
                pair(f"goal_{k}_", f"position of goal {k}", "m", spec.half_size) for k in range(n)
            )
            self.extras = tuple(chain.from_iterable(pairs))
            self.features = goal_features(n)
        self._radius = rules.goal_radius
        self.terms = _shared_terms(rules) if self._is_shared else _own_terms(rules)
        self.solved = (
            f"every goal has a robot within {rules.goal_radius:g} m"
            if self._is_shared
            else f"every robot is within {rules.goal_radius:g} m of its target"
        )
        self._scratch = (np.zeros((n, n)), *assignment_work(n))

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        rules = spec.rules_as(NavigationRules)
        if rules.goals == "assigned":
            text = "Rings are goals, in the color of their robot."
            return Appearance(legend=text, radius=rules.goal_radius)
        text, shared = "Rings are goals, which any robot may cover.", SharedTargets(spec.n_agents)
        return Appearance(legend=text, radius=rules.goal_radius, shared=shared)

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        robots = robots_of(states, self.spec.n_agents)
        if self._layout is not None:
            layouts[copies] = self._layout
        if self._place is not None:
            self._place(seeds, copies, robots)
        else:
            spawn_random(self.spec, self._plan, seeds, copies, layouts, robots)
        self.complete(states, copies)

    def complete(self, states: Float, copies: Int) -> None:
        """Completes states of which robots and targets are known; see `interfaces.Task`."""
        if self._is_shared:
            share_goals(states, copies, self.spec.n_agents, self._radius)

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        if self._is_shared:
            score_coverage(
                before.states, now.states, active, self._radius, self._scratch, now.reward_terms,
                solved,
            )  # fmt: skip
        else:
            score_navigation(
                before.states, now.states, active, self._radius, now.reward_terms, solved
            )

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        if self._is_shared:
            write_goal_features(states, active, self.spec.n_agents, self._radius, out)

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        n, last = self.spec.n_agents, episode.states[-1]
        robots = robots_of(last, n).astype(np.float64)
        places, goals = robots[:, [X, Y]], robots[:, [TX, TY]]
        if self._is_shared:
            goals = last[N_COLUMNS * n :].reshape(n, 1, 2).astype(np.float64)
        away = np.sqrt(((goals - places) ** 2).sum(axis=-1))  # [N], or [goals, robots]
        reached = (away <= self._radius) if away.ndim == 1 else (away <= self._radius).any(axis=1)
        return {"reached_fraction": float(reached.mean())}


def _own_terms(rules: NavigationRules) -> tuple[Term, ...]:
    distance = (
        "d: distance, m, from the robot (x, y) to its target (tx, ty) after the step; d': before it"
    )
    w, radius = rules.rewards, rules.goal_radius
    return (
        Term("progress", w.progress, 1, "(d' - d)", distance),
        Term("time", w.time, -1, f"[d > {radius:g}]", distance),
    )


def _shared_terms(rules: NavigationRules) -> tuple[Term, ...]:
    w, radius = rules.rewards, rules.goal_radius
    left = (
        "D: sum of the distances, m, from robots to goals after the step, the smallest over all "
        "assignments of one goal to each robot; D': before it; N: number of robots"
    )
    is_open = f"open: number of goals with no robot within {radius:g} m after the step"
    return (
        Term("progress", w.progress, 1, "(D' - D) / N", left),
        Term("time", w.time, -1, "open / N", f"{is_open}; N: number of robots"),
    )


def _check_separation(spec: TaskSpec, goal_radius: float) -> None:
    """Raises if unassigned goals can be so close that a robot covers two of them."""
    radii = sorted(robot.radius for robot in spec.robots)
    apart = sum(radii[:2]) + spec.spawn.goal_separation
    if spec.n_agents > 1 and apart <= 2 * goal_radius:
        raise SpecError(
            f"unassigned goals can be {apart:.3f} m apart (two radii and spawn.goal_separation), "
            f"expected more than two goal radii ({2 * goal_radius:.3f} m), so that no robot covers "
            "two. Enlarge spawn.goal_separation or reduce rules.goal_radius."
        )
