"""Idle, random and straight: what they command, and that batches do not matter."""

import numpy as np

from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env, make_policy
from swarmdata.specs.state_layout import TX, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

SPEC = TaskSpec()


def first_step(n_copies: int) -> Step:
    return make_env(SPEC, n_copies).reset(evaluation_seeds(n_copies))


def test_idle_commands_zero() -> None:
    assert not make_policy("idle", SPEC).act(first_step(3)).any()


def test_random_is_uniform_and_changes_with_seed_time_robot_and_component() -> None:
    step = first_step(1)._replace(
        seeds=np.arange(4000, dtype=np.uint64), times=np.zeros(4000, dtype=np.int64)
    )
    policy = make_policy("random", SPEC)
    actions = policy.act(step)
    assert actions.min() >= -1.0
    assert actions.max() < 1.0
    np.testing.assert_allclose(actions.mean(axis=0), 0.0, atol=0.04)
    np.testing.assert_allclose(actions.std(axis=0), 3.0**-0.5, atol=0.02)
    columns = actions.reshape(4000, -1)
    assert np.abs(np.corrcoef(columns.T) - np.eye(8)).max() < 0.06
    assert (policy.act(step._replace(times=step.times + 1)) != actions).mean() > 0.99


def test_straight_points_at_the_goal_and_brakes() -> None:
    step = first_step(2)
    robots = robots_of(step.states, 4)
    robots[0, 0] = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.3, 0.4)  # 0.5 m away: full speed
    robots[0, 1] = (1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.85)  # 0.15 m away: half speed
    robots[0, 2, TX:] = robots[0, 2, :2]
    actions = make_policy("straight", SPEC).act(step)
    np.testing.assert_allclose(actions[0, 0], (0.6, 0.8), atol=1e-6)
    np.testing.assert_allclose(actions[0, 1], (0.0, -0.5), atol=1e-6)
    assert not actions[0, 2].any()
