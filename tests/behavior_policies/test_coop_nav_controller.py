"""The scripted policy of coop_nav on every preset, its assignment of goals, its turns at a door."""

from itertools import permutations

import numpy as np
import pytest

from swarmdata.behavior_policies.coop_nav_controller import CoopNavController, turns_at_door
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec


def test_unassigned_goals_are_shared_out_by_least_squares() -> None:
    spec = preset("coop_nav-unassigned")
    env, policy = make_env(spec, 8), CoopNavController(spec)
    step = env.reset(np.arange(8, dtype=np.uint64))
    policy.reset(step, np.arange(8))
    for b in range(8):
        places = robots_of(step.states[b], 4)[:, [X, Y]].astype(np.float64)
        goals = step.states[b, 4 * N_COLUMNS :].reshape(4, 2).astype(np.float64)
        costs = [
            (((goals[list(order)] - places) ** 2).sum(), order) for order in permutations(range(4))
        ]
        np.testing.assert_array_equal(policy._targets[b], goals[list(min(costs)[1])])


def test_an_assignment_stays_for_the_episode_and_other_copies() -> None:
    spec = preset("coop_nav-unassigned")
    env, policy = make_env(spec, 2), CoopNavController(spec)
    step = env.reset(np.arange(2, dtype=np.uint64))
    policy.reset(step, np.arange(2))
    kept = policy._targets.copy()
    for _ in range(10):
        step = env.step(policy.act(step))
    step = env.reset(np.array([7], dtype=np.uint64), np.array([1]))
    policy.reset(step, np.array([1]))
    np.testing.assert_array_equal(policy._targets[0], kept[0])
    assert (policy._targets[1] != kept[1]).any()


def test_assigned_goals_are_the_generic_controllers() -> None:
    spec = preset("coop_nav")
    step = make_env(spec, 2).reset(np.arange(2, dtype=np.uint64))
    own, generic = CoopNavController(spec, noise=0.1), Scripted(spec, noise=0.1)
    for policy in (own, generic):
        policy.reset(step, np.arange(2))
    np.testing.assert_array_equal(own.act(step), generic.act(step))


def test_the_right_team_waits_until_the_left_one_is_through() -> None:
    robots = np.zeros((2, 3, N_COLUMNS), dtype=np.float32)
    robots[..., X] = [[-0.5, 1.0, 0.5], [0.4, 1.0, 0.5]]
    robots[..., Y] = 0.25
    robots[..., [TX, TY]] = 9.0
    targets = turns_at_door(robots, 0.22)
    np.testing.assert_array_equal(targets[0], [[9.0, 9.0], [1.0, 0.25], [9.0, 9.0]])
    np.testing.assert_array_equal(targets[1], np.full((3, 2), 9.0))


def test_other_tasks_and_noise_that_is_none_are_refused() -> None:
    with pytest.raises(SpecError, match="expected 'coop_nav'"):
        CoopNavController(TaskSpec(rules=WarehouseRules()))
    with pytest.raises(SpecError, match="noise"):
        CoopNavController(TaskSpec(), noise=-1.0)
