"""Cooperative navigation: N robots drive to their own goals among obstacles and each other.

State: the robots (`states.ROBOT`); a robot's target is its goal.
Action: a command (`dynamics`).
Observation: that of the observation model; the task adds nothing.

Own reward of robot i, with weights w from `spec.rules.rewards`, d its distance to its goal before
(d') and after the step, and [x] one if x holds, else zero:

    w.progress (d' - d) - w.time [d > goal_radius]

`engine.TaskEnv` adds what all tasks share. Solved: all robots within `goal_radius` of their goals
at the same time.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numba import njit

from swarmdata.envs.spawn import SpawnPlan, spawn_random
from swarmdata.errors import SpecError
from swarmdata.features import Feature
from swarmdata.spec import NavigationRules, Payload, TaskSpec
from swarmdata.states import N_COLUMNS, TX, TY, robots_of
from swarmdata.types import Bool, Double, Episode, Float, Int, Metric, Seeds, Step


@njit(nogil=True, cache=True)
def score_navigation(
    before: Float,
    after: Float,
    active: Bool,
    goal_radius: float,
    weights: tuple[float, float],
    rewards: Double,
    solved: Bool,
) -> None:
    """Writes the task's own rewards of the active copies, and whether all are at their goals.

    Args:
        before: states before the step, [E, S].
        after: states after the step, [E, S].
        active: [E].
        goal_radius: m.
        weights: of progress and of time.
        rewards: written, [E, N].
        solved: written, [E].
    """
    for b in range(before.shape[0]):
        if not active[b]:
            continue
        everyone = True
        for i in range(rewards.shape[1]):
            old = _goal_distance(before[b], i)
            new = _goal_distance(after[b], i)
            outside = new > goal_radius
            everyone = everyone and not outside
            rewards[b, i] = weights[0] * (old - new) - (weights[1] if outside else 0.0)
        solved[b] = everyone


@njit(nogil=True, cache=True, inline="always")
def _goal_distance(state: Float, i: int) -> float:
    r = N_COLUMNS * i
    dx = float(state[r + TX]) - float(state[r])
    dy = float(state[r + TY]) - float(state[r + 1])
    return math.sqrt(dx * dx + dy * dy)


METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "reached_fraction": Metric(
            "robots at goal", "", "higher", "share of robots within the goal radius at the end"
        )
    }
)
"""What this task measures besides `metrics.EPISODE_METRICS`."""


class CoopNav:
    """Implements `interfaces.Task`.

    Raises:
        SpecError: the spec is another task's.
    """

    metrics: ClassVar[Mapping[str, Metric]] = METRICS

    def __init__(self, spec: TaskSpec) -> None:
        if not isinstance(spec.rules, NavigationRules):
            raise SpecError(f"rules.task is {spec.rules.task!r}, expected 'coop_nav'")
        self.spec = spec
        self._plan = SpawnPlan.of(spec)
        self.kinds: Int = self._plan.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras: tuple[str, ...] = ()
        self.features: tuple[Feature, ...] = ()
        self._radius = spec.rules.goal_radius
        self._weights = (spec.rules.rewards.progress, spec.rules.rewards.time)

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        spawn_random(self._plan, seeds, copies, layouts, robots_of(states, self.spec.n_agents))

    def update(self, before: Step, now: Step, active: Bool, rewards: Double, solved: Bool) -> None:
        score_navigation(
            before.states, now.states, active, self._radius, self._weights, rewards, solved
        )

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        """Writes nothing: the task adds no features."""

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        robots = robots_of(episode.states[-1], self.spec.n_agents).astype(np.float64)
        away = np.hypot(robots[:, TX] - robots[:, 0], robots[:, TY] - robots[:, 1])
        return {"reached_fraction": float((away <= self._radius).mean())}
