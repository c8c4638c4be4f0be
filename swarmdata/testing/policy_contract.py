"""check_policy, the contract of every policy."""

import pickle
import random
from collections.abc import Callable
from dataclasses import fields
from functools import partial

import numpy as np

from swarmdata.interfaces import Policy, VecEnv
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Episode, Float, Seeds, Step

MakeEnv = Callable[[TaskSpec, int], VecEnv]

FIRST_SEED = EVALUATION_BASE + (1 << 40)
"""First of the reserved seeds that no evaluation uses."""


def check_policy(
    policy: Policy, spec: TaskSpec, make_env: MakeEnv, *, n_episodes: int = 7, n_steps: int = 20
) -> None:
    """Checks every promise of `interfaces.Policy`.

    Args:
        policy: under test; it is reset and used in environments of several sizes.
        spec: the task it was made for; a short horizon makes the check fast.
        make_env: builds copies of that task, such as `registry.make_env`.
        n_episodes: how many episodes must be the same bits in any batch.
        n_steps: how many steps are compared action by action.

    Raises:
        AssertionError: a promise is broken.
    """
    _check_actions(policy, spec, make_env, n_steps)
    _check_log_probs(policy, spec, make_env, n_steps)
    _check_batches(policy, spec, make_env, n_episodes)  # `_check_sight` relies on it
    _check_sight(policy, spec, make_env, n_steps)


def _check_actions(policy: Policy, spec: TaskSpec, make_env: MakeEnv, n_steps: int) -> None:
    """Actions are new arrays, finite and in range, and `act` has no side effects."""
    assert isinstance(policy, Policy), (
        f"{type(policy).__name__} lacks one of uses_state, reset(step, copies), act(step), "
        "log_probs(step, actions)"
    )
    assert isinstance(policy.uses_state, bool), f"uses_state is {policy.uses_state!r}, not a bool"
    env, step = _start(policy, spec, make_env)
    expected = env.n_copies, spec.n_agents, env.action_size
    for _ in range(n_steps):
        actions = _without_traces(partial(policy.act, step), step, "act")
        assert actions.dtype == np.float32, f"actions are {actions.dtype}, not float32"
        assert actions.shape == expected, f"actions are {actions.shape}, not [E, N, A] {expected}"
        assert np.isfinite(actions).all(), "actions are not finite"
        assert (np.abs(actions) <= 1).all(), f"actions reach {np.abs(actions).max():g}, above 1"
        kept = actions.copy()
        step = env.step(actions)
        assert np.array_equal(actions, kept), "the environment changed the actions"


def _check_log_probs(policy: Policy, spec: TaskSpec, make_env: MakeEnv, n_steps: int) -> None:
    """Log-probabilities of the policy's actions are finite, elementwise, pure and repeatable."""
    env, step = _start(policy, spec, make_env)
    expected = env.n_copies, spec.n_agents
    for _ in range(n_steps):
        actions = policy.act(step).copy()
        kept = actions.copy()
        compute = partial(policy.log_probs, step, actions)
        log_probs = _without_traces(compute, step, "log_probs").copy()
        assert np.array_equal(actions, kept), "log_probs wrote to the actions"
        assert log_probs.dtype == np.float32, f"log_probs are {log_probs.dtype}, not float32"
        assert log_probs.shape == expected, (
            f"log_probs are {log_probs.shape}, not [E, N] {expected}"
        )
        assert np.isfinite(log_probs).all(), "log_probs of the policy's own actions are not finite"
        again = policy.log_probs(step, actions)
        assert np.array_equal(again, log_probs), "log_probs differ when they are computed again"
        other = actions.copy()
        other[0, 0] = np.where(other[0, 0] > 0.0, -0.5, 0.5)
        changed = policy.log_probs(step, other) != log_probs
        changed[0, 0] = False
        assert not changed.any(), (
            "the log-probability of an action depends on other robots' actions"
        )
        step = env.step(actions)


def _check_sight(policy: Policy, spec: TaskSpec, make_env: MakeEnv, n_steps: int) -> None:
    """A policy that does not declare `uses_state` acts the same where only observations show."""
    if policy.uses_state:
        return
    seeing, blind = (_actions(policy, spec, make_env, n_steps, hidden=h) for h in (False, True))
    assert np.array_equal(seeing, blind), (
        "the actions depend on states, layouts or rewards, which robots do not see; "
        "use observations only, or declare uses_state = True"
    )


def _check_batches(policy: Policy, spec: TaskSpec, make_env: MakeEnv, n_episodes: int) -> None:
    """An episode is the same bits alone, in a batch, first, last, and when run again."""
    seeds = np.arange(FIRST_SEED, FIRST_SEED + n_episodes, dtype=np.uint64)
    alone = _episodes(policy, spec, make_env, seeds, 1)
    for n_copies, order in ((1, seeds), (3, seeds), (3, seeds[::-1]), (n_episodes, seeds)):
        batch = _episodes(policy, spec, make_env, order.copy(), n_copies)
        for seed in alone:
            for name in (field.name for field in fields(Episode)):
                assert np.array_equal(getattr(alone[seed], name), getattr(batch[seed], name)), (
                    f"episode {seed} has other {name} in {n_copies} copies than alone; randomness "
                    "and memory must depend on step.seeds and step.times only, and "
                    "reset(step, copies) must forget exactly the copies it names"
                )


def _start(
    policy: Policy, spec: TaskSpec, make_env: MakeEnv, hidden: bool = False
) -> tuple[VecEnv, Step]:
    env = make_env(spec, 3)
    step = env.reset(np.arange(FIRST_SEED, FIRST_SEED + 3, dtype=np.uint64))
    policy.reset(_hide(step) if hidden else step, np.arange(3))
    return env, step


def _without_traces(compute: Callable[[], Float], step: Step, name: str) -> Float:
    """Computes; checks that it left the step and the global generators as they were."""

    def generators() -> tuple[object, ...]:
        return random.getstate(), pickle.dumps(np.random.get_state())  # noqa: NPY002

    before, drawn = [field.copy() for field in step], generators()
    found = compute()
    assert generators() == drawn, (
        f"{name} drew from a global generator; use numerics.random.derive(step.seeds, step.times)"
    )
    for field, old, new in zip(Step._fields, before, step, strict=True):
        assert np.array_equal(old, np.asarray(new)), f"{name} wrote to step.{field}"
    return found


def _actions(
    policy: Policy, spec: TaskSpec, make_env: MakeEnv, n_steps: int, *, hidden: bool
) -> Float:
    """Actions of three copies and their log-probabilities, [n_steps, E, N, A + 1]."""
    env, step = _start(policy, spec, make_env, hidden)
    rows = []
    for _ in range(n_steps):
        shown = _hide(step) if hidden else step
        actions = policy.act(shown).copy()
        log_probs = policy.log_probs(shown, actions)[..., None]
        rows.append(np.concatenate([actions, log_probs], axis=-1))
        step = env.step(actions)
    return np.stack(rows)


def _hide(step: Step) -> Step:
    names = ("states", "layouts", "rewards")
    return step._replace(**{name: np.full_like(getattr(step, name), np.nan) for name in names})


def _episodes(
    policy: Policy, spec: TaskSpec, make_env: MakeEnv, seeds: Seeds, n_copies: int
) -> dict[int, Episode]:
    env = make_env(spec, n_copies)
    return {episode.seed: episode for episode in rollout(env, policy, seeds)}
