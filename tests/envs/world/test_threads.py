"""Copies stepped by several threads: the bits of one thread, its errors, and nothing shared."""

import threading
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import SchemaError, SpawnError
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import TASKS, make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import STATE_FIELDS, STEP_FIELDS, Seeds, Step
from tests.envs.worlds import assert_same
from tests.support.pairs import once_each

MODELS: dict[str, dict[str, Any]] = {
    "plain": {},
    "noisy radio": {
        "observation": {"kind": "bearing", "dropout": 0.1, "delay": 1, "stack": 2},
        "communication": {
            "kind": "broadcast", "range": 2.0, "drop_probability": 0.3, "delay": 2,
            "messages_per_step": 2,
        },
    },
    "noisy lidar": {"observation": {"kind": "lidar", "n_rays": 8, "noise": {"range": 0.05}}},
    "occupancy": {"observation": {"kind": "occupancy"}},
}  # fmt: skip


def some_seeds(n: int, first: int = 0) -> Seeds:
    return np.arange(first, first + n, dtype=np.uint64)


def drive(env: VecEnv, n_steps: int) -> list[Step]:
    """Steps with random actions; copies that end are reset in the next step."""
    rng = np.random.default_rng(3)
    steps, used = [env.reset(some_seeds(env.n_copies))], env.n_copies
    for _ in range(n_steps):
        actions = rng.uniform(-1, 1, (env.n_copies, env.spec.n_agents, env.action_size))
        steps.append(env.step(actions))
        ended = np.flatnonzero(steps[-1].ended)[::-1]
        if len(ended) > 1:  # the last of them stays as it is
            ended = ended[1:]
            steps.append(env.reset(some_seeds(len(ended), used), ended))
            used += len(ended)
    return steps


@pytest.mark.parametrize(("task", "models"), once_each(tuple(TASKS), tuple(MODELS)))
def test_every_number_of_threads_gives_the_same_bits(task: str, models: str) -> None:
    spec = preset(task).with_updates(horizon=12, **MODELS[models])
    if len(spec.sides) == 1:
        spec = spec.with_updates(on_collision="fail")
    expected = drive(make_env(spec, 7), 30)
    for n_threads in (2, 7):
        env = make_env(spec, 7, n_threads=n_threads)
        assert_same(drive(env, 30), expected)
        env.close()


def test_episodes_and_results_are_the_same() -> None:
    spec = preset("coop_nav").with_updates(horizon=20)
    policy, ids = make_policy("scripted", spec), some_seeds(11)
    env = make_env(spec, 4, n_threads=3)
    for one, two in zip(
        rollout(make_env(spec, 4), policy, ids), rollout(env, policy, ids), strict=True
    ):
        for name in (*STATE_FIELDS, *STEP_FIELDS):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    env.close()
    results = [
        evaluate(policy, spec, name="scripted", n_episodes=9, n_threads=n, progress=False)
        for n in (1, 2)
    ]
    for name, values in results[0].metrics.items():
        np.testing.assert_array_equal(values, results[1].metrics[name])
    assert not any(each.name == "swarmdata-step" for each in threading.enumerate())


@pytest.mark.parametrize("n_threads", [1, 2])
def test_a_malformed_action_leaves_every_world_as_it_was(n_threads: int) -> None:
    spec = preset("coop_nav")
    env, other = (make_env(spec, 4, n_threads=n_threads) for _ in range(2))
    for each in (env, other):
        each.reset(some_seeds(4))
    actions = np.full((4, 4, 2), 0.5)
    actions[3, 1, 0] = np.nan
    with pytest.raises(SchemaError, match="NaN or infinite"):
        env.step(actions)
    actions[3, 1, 0] = 0.5
    assert_same([env.step(actions)], [other.step(actions)])
    env.close()
    other.close()


@pytest.mark.parametrize("n_threads", [1, 2])
def test_a_layout_that_is_not_found_leaves_every_world_as_it_was(
    n_threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = preset("coop_nav")
    env, other = (make_env(spec, 4, n_threads=n_threads) for _ in range(2))
    for each in (env, other):
        each.reset(some_seeds(4))
    assert isinstance(env, TaskEnv)
    last = env._blocks[-1].task

    def fail(*_: object) -> None:
        raise SpawnError("no layout for seed 9")

    with monkeypatch.context() as patch:
        patch.setattr(last, "spawn", fail, raising=False)
        with pytest.raises(SpawnError, match="no layout for seed 9"):
            env.reset(some_seeds(4, 6))
    actions = np.full((4, 4, 2), 0.5)
    assert_same([env.step(actions)], [other.step(actions)])
    env.close()
    other.close()


def test_numbers_of_threads_are_checked() -> None:
    env = make_env(TaskSpec(), 2, n_threads=6)
    assert isinstance(env, TaskEnv)
    assert env.n_threads == 2
    env.close()
    with pytest.raises(SchemaError, match="n_threads is 0, expected at least 1"):
        make_env(TaskSpec(), 4, n_threads=0)
    with pytest.raises(SchemaError, match="1 copy and 1 thread"):
        make_env(TaskSpec(), n_threads=2, api="pettingzoo")  # type: ignore[call-overload]
