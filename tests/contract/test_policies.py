"""Every registered policy keeps the contract, and the suite notices every broken promise."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.registry import components
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import checkpoints, sources
from swarmdata.registry.tiers import LEARNED_FAMILIES, TRAINED_TIERS
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.specs.rules import PACKAGE_RULES, rules_model
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy
from swarmdata.types import Float, Int, Step
from tests.support.pairs import once_each

SPEC = TaskSpec(horizon=25)


SHIPPED = [
    (family, tier)
    for family in LEARNED_FAMILIES
    for tier in TRAINED_TIERS
    if checkpoints(family, tier)
]
"""Every shipped tier, whose first team acts; the others are run by the same code."""

DEFAULT_NOISE = {"medium": 0.0, "expert": 0.2}
"""Of default cases, which are those of a preset of each task."""

NOISY = [
    pytest.param(
        family,
        tier,
        noise,
        id=f"{family}-{tier}-{noise}",
        marks=[pytest.mark.slow]
        if family not in components.TASKS or noise != DEFAULT_NOISE.get(tier)
        else [],
    )
    for family, tier in SHIPPED
    for noise in (0.0, 0.2)
]


OF_ONE_TASK = {name: task for task in PACKAGE_RULES for name in rules_model(task).naive_teams}
"""Policies that only one task has."""


@pytest.mark.parametrize("name", sorted(components.checkpoint_free_policies()))
def test_registered_policies_keep_the_contract(name: str) -> None:
    spec = preset(OF_ONE_TASK[name]).with_updates(horizon=25) if name in OF_ONE_TASK else SPEC
    check_policy(make_policy(name, spec), spec, make_env)


@pytest.mark.parametrize(("task", "noise"), once_each(sorted(components.TASKS), (0.0, 0.3)))
def test_scripted_policies_of_all_tasks_keep_the_contract(task: str, noise: float) -> None:
    spec = preset(task).with_updates(horizon=6)
    policy = make_policy("scripted", spec, noise=noise)
    check_policy(policy, spec, make_env, n_episodes=3, n_steps=5)


@pytest.mark.parametrize("task", sorted(components.TASKS))
def test_scripted_policies_with_a_memory_have_to_be_told_of_every_episode(task: str) -> None:
    """Their kernels would write where there is no memory."""
    spec = preset(task).with_updates(horizon=6)
    policy: Any = make_policy("scripted", spec)
    env = make_env(spec, 3)
    step = env.reset(np.arange(3, dtype=np.uint64))
    if not policy.has_memory:
        actions = policy.act(step)
        policy.reset(step, np.arange(3))
        np.testing.assert_array_equal(policy.act(step), actions)
        return
    untold = "was not told of some episodes"
    with pytest.raises(SchemaError, match=untold):
        policy.act(step)
    policy.reset(step, np.array([0, 2]))
    with pytest.raises(SchemaError, match=untold):
        policy.act(step)
    policy.reset(step, np.array([1]))
    assert np.isfinite(policy.act(step)).all()
    again = env.reset(np.array([7], dtype=np.uint64), np.array([1]))
    with pytest.raises(SchemaError, match=untold):
        policy.act(again)
    with pytest.raises(SchemaError, match=untold):
        policy.act(make_env(spec, 2).reset(np.arange(2, dtype=np.uint64)))


@pytest.mark.parametrize(("family", "tier", "noise"), NOISY)
def test_shipped_actors_keep_the_contract(family: str, tier: str, noise: float) -> None:
    spec = preset(family).with_updates(horizon=12)
    policy = make_source_policy(sources(family, tier, noise)[0], spec)
    check_policy(policy, spec, make_env, n_episodes=4, n_steps=10)


class Made:
    """A policy that follows what it observes, or breaks a promise by one of its functions."""

    uses_state = False

    def __init__(
        self,
        act: Callable[[Float, Step, int], Float] = lambda actions, step, calls: actions,
        log_probs: Callable[[Float, int], Float] | None = None,
    ) -> None:
        self.calls, self._act, self._log_probs = 0, act, log_probs

    def reset(self, step: Step, copies: Int) -> None:
        pass

    def act(self, step: Step) -> Float:
        self.calls += 1
        return self._act(np.clip(step.observations[..., 6:8], -1.0, 1.0), step, self.calls)

    def log_probs(self, step: Step, actions: Float) -> Float:
        self.calls += 1
        if self._log_probs is None:
            return np.zeros(actions.shape[:2], np.float32)
        return self._log_probs(actions, self.calls)


def vandal(actions: Float, step: Step, calls: int) -> Float:
    step.observations[0, 0, 0] += 1
    return actions


def seer(actions: Float, step: Step, calls: int) -> Float:
    robots = step.states.reshape(len(step.states), -1, 8)
    goals: Float = np.tanh(np.nan_to_num(robots[..., 6:]))
    return goals


def gambler(actions: Float, step: Step, calls: int) -> Float:
    return actions * np.float32(np.random.random())  # noqa: NPY002


def crowd(actions: Float, step: Step, calls: int) -> Float:
    """Copies influence each other."""
    mixed: Float = (0.5 * actions + 0.5 * actions.mean(0)).astype(np.float32)
    return mixed


def full(actions: Float, value: float) -> Float:
    return np.full(actions.shape[:2], value, np.float32)


def test_a_good_policy_passes() -> None:
    check_policy(Made(), SPEC, make_env)


def test_what_is_no_policy_is_named() -> None:
    with pytest.raises(AssertionError, match="object lacks one of uses_state"):
        check_policy(object(), SPEC, make_env)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda actions, step, calls: 3 * actions, r"actions reach 2\.\d+, above 1"),
        (lambda actions, step, calls: actions.astype(np.float64), "are float64, not float32"),
        (lambda actions, step, calls: actions[:, 0], r"actions are \(3, 2\), not \[E, N, A\]"),
        (lambda actions, step, calls: actions * np.float32(np.nan), "actions are not finite"),
        (lambda actions, step, calls: actions * np.float32(1 / (1 + calls % 7)), "has other"),
        (gambler, "global generator"),
        (vandal, "act wrote to step.observations"),
        (seer, "declare uses_state = True"),
        (crowd, "has other .* copies than alone"),
    ],
)
def test_each_broken_promise_of_actions_is_found(
    act: Callable[[Float, Step, int], Float], message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check_policy(Made(act), SPEC, make_env)


@pytest.mark.parametrize(
    ("log_probs", "message"),
    [
        (lambda actions, calls: full(actions, -np.inf), "own actions are not finite"),
        (lambda actions, calls: 0 * actions, r"log_probs are \(3, 4, 2\), not \[E, N\]"),
        (lambda actions, calls: full(actions, -calls), "differ when they are computed again"),
        (lambda actions, calls: full(actions, actions.sum()), "depends on other robots"),
    ],
)
def test_each_broken_promise_of_log_probs_is_found(
    log_probs: Callable[[Float, int], Float], message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        check_policy(Made(log_probs=log_probs), SPEC, make_env)
