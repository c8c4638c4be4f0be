"""Who surrounds which evader, and where the others search."""

import numpy as np
import pytest

from swarmdata.behavior_policies.pursuit.beliefs import Beliefs, Hunt, blank_beliefs
from swarmdata.behavior_policies.pursuit.groups import (
    NO_GROUP,
    Plans,
    blank_plans,
    choose_goals,
    form_groups,
    goals_of_chases,
)
from swarmdata.types import Double
from tests.behavior_policies.pursuit.hunts import NOTHING, hunt

SEED, RINGS = np.uint64(3), np.zeros((0, 2))


def team(mates: list[tuple[float, float]], evaders: list[tuple[float, float]], views: int = 1
         ) -> tuple[Beliefs, Plans]:  # fmt: skip
    sizes = (1, views, len(mates), len(evaders))
    beliefs = Beliefs(*(array[0] for array in blank_beliefs(*sizes)))
    beliefs.mates[:], beliefs.places[:], beliefs.ages[:] = mates, evaders, 0.0
    return beliefs, Plans(*(array[0] for array in blank_plans(*sizes)))


def choose(time: int, hunt: Hunt, beliefs: Beliefs, plans: Plans, leads: Double = RINGS) -> Double:
    goals = np.full(beliefs.mates.shape[1:], np.nan)
    choose_goals(SEED, time, NOTHING, leads, hunt, beliefs, plans, goals)
    return goals


def test_each_evader_gets_its_nearest_robots_and_keeps_them() -> None:
    constants = hunt(5, 2, 2)
    beliefs, plans = team([(0, 0), (3, 0), (0.2, 0), (3.2, 0), (-3, -3)], [(3.5, 0), (0.5, 0.5)])
    form_groups(0, constants, beliefs, plans)
    assert plans.groups[0].tolist() == [1, 0, 1, 0, NO_GROUP]
    beliefs.mates[0] = beliefs.mates[0, ::-1]
    form_groups(0, constants, beliefs, plans)
    assert plans.groups[0].tolist() == [1, 0, 1, 0, NO_GROUP]
    beliefs.are_gone[0, 1] = True
    form_groups(0, constants, beliefs, plans)
    assert plans.groups[0].tolist() == [NO_GROUP, 0, NO_GROUP, 0, NO_GROUP]


def test_too_few_robots_form_no_group_and_stay_while_all_is_known() -> None:
    beliefs, plans = team([(0, 0), (1, 0)], [(2, 0)])
    goals = choose(0, hunt(2, 1, 3), beliefs, plans)
    np.testing.assert_array_equal(goals, beliefs.mates[0])


def test_robots_search_their_own_sectors_until_they_have_been_there() -> None:
    constants = hunt(3, 1, 3)
    beliefs, plans = team([(0, 0), (0.5, 0), (1, 0)], [(9, 9)])
    beliefs.ages[:] = 99.0
    first = choose(0, constants, beliefs, plans)
    assert (np.abs(first) <= 3.7).all()
    turns = np.arctan2(first[:, 1], first[:, 0]) % (2 * np.pi) / (2 * np.pi)
    assert np.abs(turns - np.array([1, 3, 5]) / 6).max() < 0.2  # walls turn them a little
    np.testing.assert_array_equal(choose(59, constants, beliefs, plans), first)
    assert (choose(60, constants, beliefs, plans) != first).any(axis=1).all()
    beliefs.mates[0, 1] = plans.search_places[1] + 0.2
    moved = choose(61, constants, beliefs, plans)
    assert (moved[1] != plans.search_places[0]).all()
    again = team([(0, 0), (0.5, 0), (1, 0)], [(9, 9)])
    again[0].ages[:] = 99.0
    np.testing.assert_array_equal(choose(0, constants, *again), first)


def test_each_robot_decides_by_its_own_view() -> None:
    constants = hunt(2, 1, 2)
    beliefs, plans = team([(0, 0), (1, 0)], [(3, 0)], views=2)
    beliefs.places[1, 0] = -3.0, 0.0
    goals = choose(0, constants, beliefs, plans, np.zeros((2, 2)))
    np.testing.assert_array_equal(goals, [[3.0, 0.0], [-3.0, 0.0]])


@pytest.mark.parametrize(
    ("lead", "ahead"), [((0.0, 0.0), 0.0), ((0.5, 1.0), 0.5 * 0.5), ((2.0, 3.0), 0.5 * 2.0)]
)
def test_robots_chase_the_nearest_evader_and_aim_ahead(
    lead: tuple[float, float], ahead: float
) -> None:
    beliefs, _ = team([(0, 0)], [(0.6, 0.0), (2.0, 0.0)])  # 1 s away
    beliefs.velocities[0, 0] = 0.0, 0.5
    goals = np.empty((1, 2))
    assert goals_of_chases(0, np.array([lead]), hunt(1, 2, 1), beliefs, goals).all()
    np.testing.assert_allclose(goals, [[0.6, ahead]])
    beliefs.are_gone[0] = True
    assert not goals_of_chases(0, np.array([lead]), hunt(1, 2, 1), beliefs, goals).any()
