"""The scripted policy of coop_nav on every preset, its assignment of goals, its turns at a door."""

from itertools import permutations, product

import numpy as np
import pytest

from swarmdata.behavior_policies.coop_nav_controller import (
    CoopNavController,
    check_convention,
    lane_targets,
    order_goals,
    turns_at_door,
)
from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.coop_nav.navigation_rules import Lanes
from swarmdata.envs.warehouse.warehouse_rules import WarehouseRules
from swarmdata.errors import SpecError
from swarmdata.numerics.random import validation_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy
from swarmdata.types import Bool


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
    spec = preset("coop_nav-unassigned").with_updates(horizon=20)
    check_policy(CoopNavController(spec), spec, make_env, n_episodes=4)


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


WITH_CONVENTIONS = ("coop_nav-lanes", "coop_nav-ranks")


def solved(name: str, follows_second: Bool) -> Bool:
    """Which episodes are solved if some robots follow the second convention [E, N], [E]."""
    spec, n = preset(name), len(follows_second)
    teams = [CoopNavController(spec, convention=each) for each in spec.rules.conventions]
    env = make_env(spec, n)
    step = env.reset(validation_seeds(n))
    for team in teams:
        team.reset(step, np.arange(n))
    while not step.ended.all():
        first, second = (team.act(step) for team in teams)
        step = env.step(np.where(follows_second[..., None], second, first))
    return step.successes


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_CONVENTIONS)
def test_teams_that_keep_a_convention_succeed_and_robots_that_mix_them_fail(name: str) -> None:
    """All 14 mixtures of 4 robots, and both conventions, 6 episodes each."""
    mixes = np.array(list(product([False, True], repeat=4)) * 6)
    agree = (mixes == mixes[:, :1]).all(axis=1)
    found = solved(name, mixes)
    assert agree.sum() == 12
    assert found[agree].all()
    assert not found[~agree].any()


def test_presets_with_conventions() -> None:
    found = {name: preset(name).rules.conventions for name in preset_names()}
    assert {name: each for name, each in found.items() if each} == {
        "coop_nav-lanes": ("keep-right", "keep-left"),
        "coop_nav-ranks": ("by-x", "by-y"),
        "coop_nav-unassigned": ("by-x", "by-y"),
    }


def test_conventions_that_a_task_lacks_are_refused() -> None:
    assert check_convention(preset("coop_nav"), None) is None
    assert check_convention(preset("coop_nav-lanes"), "keep-left") == "keep-left"
    with pytest.raises(SpecError, match="'by-x', expected keep-right or keep-left in this task"):
        CoopNavController(preset("coop_nav-lanes"), convention="by-x")
    with pytest.raises(SpecError, match="'keep-left', expected none in this task"):
        check_convention(preset("warehouse"), "keep-left")


def test_robots_drive_through_their_lane_and_then_to_their_goals() -> None:
    robots = np.zeros((1, 4, N_COLUMNS), dtype=np.float32)
    robots[0, :, X] = [-2.0, 2.0, 0.0, -1.0]
    robots[..., TX], robots[..., TY] = 7.0, 8.0
    right = lane_targets(robots, Lanes(), "keep-right")
    left = lane_targets(robots, Lanes(), "keep-left")
    expected = [[0.0, -0.5], [0.0, 0.5], [1.4, -0.5], [7.0, 8.0]]
    np.testing.assert_allclose(right[0], expected)
    np.testing.assert_allclose(left[0], np.array(expected) * [[1, -1], [1, -1], [1, -1], [1, 1]])


def test_goals_are_ordered_along_an_axis_and_ties_by_number() -> None:
    states = np.zeros((2, 3 * N_COLUMNS + 6), dtype=np.float32)
    states[1, 3 * N_COLUMNS :] = [0.5, 1.0, -0.5, 1.0, 0.0, -2.0]
    out = np.full((2, 3, 2), 9.0)
    order_goals(states, np.array([1]), 3, 0, out)
    np.testing.assert_array_equal(out[1], [[-0.5, 1.0], [0.0, -2.0], [0.5, 1.0]])
    order_goals(states, np.array([1]), 3, 1, out)
    np.testing.assert_array_equal(out[1], [[0.0, -2.0], [0.5, 1.0], [-0.5, 1.0]])
    assert (out[0] == 9.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_CONVENTIONS)
def test_the_contract_of_policies_is_kept(name: str) -> None:
    spec = preset(name).with_updates(horizon=25)
    for convention in spec.rules.conventions:
        check_policy(CoopNavController(spec, noise=0.1, convention=convention), spec, make_env)


def test_other_tasks_and_noise_that_is_none_are_refused() -> None:
    with pytest.raises(SpecError, match="expected 'coop_nav'"):
        CoopNavController(TaskSpec(rules=WarehouseRules()))
    with pytest.raises(SpecError, match="noise"):
        CoopNavController(TaskSpec(), noise=-1.0)
