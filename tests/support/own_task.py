"""A task of a user, as another package would define it, and datasets of it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
import pytest

import swarmdata
from swarmdata.envs.world.spawn import SpawnPlan, spawn_random
from swarmdata.runtime import own_components
from swarmdata.runtime.own_components import GROUPS, REGISTERED_VARIABLE
from swarmdata.specs.features import Feature
from swarmdata.specs.quantities import Length, Weight
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.rules import Payload, Rewards, TaskRules
from swarmdata.specs.state_layout import N_COLUMNS, TX, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Column, Double, Episode, Float, Int, Metric, Seeds, Step, Term
from tests.support.tiny import make_tiny


class ThriftyRewards(Rewards):
    """Weights of `thrifty`."""

    progress: Weight = 1.0  # per metre that a robot comes closer to its target
    driven: Weight = 0.1  # per metre that it drives


class ThriftyRules(TaskRules):
    """Rules of `thrifty`."""

    task: Literal["thrifty"] = "thrifty"
    goal_radius: Length = 0.2
    rewards: ThriftyRewards = ThriftyRewards()


class Thrifty:
    """Robots drive to targets of their own on short ways; says nothing that a task need not say.

    State: the robots, then the metres that the team has driven.
    """

    Rules: ClassVar[type[TaskRules]] = ThriftyRules
    metrics: ClassVar[Mapping[str, Metric]] = MappingProxyType(
        {"driven": Metric("way driven", "m", "lower", "way of all robots")}
    )

    def __init__(self, spec: TaskSpec) -> None:
        rules = spec.rules_as(ThriftyRules)
        self.spec, self._radius, self._plan = spec, rules.goal_radius, SpawnPlan.of(spec)
        self.kinds: Int = self._plan.kinds
        self.movables: tuple[Payload, ...] = ()
        self.extras = (Column("driven", "way that the team has driven", "m", low=0),)
        self.features: tuple[Feature, ...] = ()
        way = "s: way, m, from the robot's place before the step to that after it"
        self.terms = (
            Term("progress", rules.rewards.progress, 1, "(d' - d)", "d: distance to its target, m"),
            Term("driven", rules.rewards.driven, -1, "s", way),
            Term("time", rules.rewards.time, -1, "1", "1: in every step"),
        )
        self.solved = f"every robot is within {self._radius:g} m of its target"

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        states[copies] = 0.0
        robots = robots_of(states, self.spec.n_agents)
        spawn_random(self.spec, self._plan, seeds, copies, layouts, robots)

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        n = self.spec.n_agents
        old, new = (robots_of(each.states, n).astype(np.float64) for each in (before, now))
        way: Double = np.hypot(*np.moveaxis(new[..., X : Y + 1] - old[..., X : Y + 1], -1, 0))
        left = _distances(new)
        terms = np.stack([_distances(old) - left, way, np.ones_like(way)], axis=-1)
        now.reward_terms[active, :, :3] = terms[active]
        now.states[active, N_COLUMNS * n] += way[active].sum(axis=1)
        solved[active] = (left[active] <= self._radius).all(axis=1)

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        pass

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        return {"driven": float(episode.states[-1, N_COLUMNS * self.spec.n_agents])}


def _distances(robots: Double) -> Double:
    """From each robot to its target, m, [E, N]."""
    away = robots[..., TX:] - robots[..., X : Y + 1]
    return np.sqrt((away * away).sum(axis=-1))


@contextmanager
def nothing_registered() -> Iterator[None]:
    """Undoes, at its end, what is registered in it; at its beginning nothing is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(own_components, "_here", {group: {} for group in GROUPS})
        patch.setenv(REGISTERED_VARIABLE, "{}")
        yield


@contextmanager
def thrifty_installed() -> Iterator[TaskSpec]:
    """Has the task `thrifty`; gives a spec of it."""
    with nothing_registered():
        swarmdata.register_task("thrifty", Thrifty)
        yield TaskSpec.parse({"rules": {"task": "thrifty"}, "horizon": 40})


def make_thrifty(out: Path) -> Path:
    """Builds a small dataset of the task in this process; afterwards the task is not known."""
    with thrifty_installed() as spec:
        policies = (PolicySource(label="a", name="random"),)
        return make_tiny(out, id="thrifty-tiny-v0", spec=spec, policies=policies)
