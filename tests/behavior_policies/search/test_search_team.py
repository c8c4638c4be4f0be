"""Where robots of a search team go, from what they know."""

import numpy as np

from swarmdata.behavior_policies.heard_goals import HEARD_X, HEARD_Y, MASK
from swarmdata.behavior_policies.search.search_team import (
    NO_INDEX,
    VICTIM_X,
    VICTIM_Y,
    Floor,
    Notes,
    assigned_victim,
    choose_goals,
)
from swarmdata.envs.search.floor_memory import RESCUED, WAITING, Columns
from swarmdata.types import Double, Float

MIDDLES = np.array([[-2.0, 0.0], [0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
COLUMNS = Columns.of(3, 2, 4)
FLOOR = Floor(COLUMNS, MIDDLES, np.array([3.0, 3.0]), 0.5, 0.3, 2, 20, 30, True)
VICTIMS = np.array([[1.5, 1.5], [-1.5, -1.5]])
NOTHING = np.zeros((0, 8), np.float32)
PLACES = np.array([[1.0, 1.0], [-0.9, 0.0], [0.9, 0.0]])
BASE = (-3.0, -3.0)


def notes() -> Notes:
    return Notes(
        looked_at=np.zeros((3, 4), np.bool_),
        is_closed=np.zeros(4, np.bool_),
        goal_squares=np.full(3, NO_INDEX),
        arrivals=np.full(3, NO_INDEX),
        returns=np.zeros((3, 2), np.int64),
    )


def state_of(known: dict[tuple[int, int], int]) -> Float:
    state = np.zeros(COLUMNS.searched + 3 * 4, np.float32)
    for i, place in enumerate(PLACES):
        state[8 * i : 8 * i + 2] = place
    state[COLUMNS.victims : COLUMNS.rescued] = VICTIMS.ravel()
    for (i, k), what in known.items():
        state[COLUMNS.known + 2 * i + k] = what
    return state


def heard_of(tells: dict[int, Double], *, radio: bool = True) -> Double:
    """What all robots have heard; robots that tell of no victim tell the base."""
    heard = np.zeros((3, 3, 5))
    heard[..., MASK] = 1.0 if radio else np.eye(3)
    heard[..., [HEARD_X, HEARD_Y]] = PLACES
    for j in range(3):
        heard[:, j, [VICTIM_X, VICTIM_Y]] = tells.get(j, BASE)
    return heard * heard[..., :1]


def goals_of(state: Float, heard: Double, mind: Notes, time: int = 0) -> list[list[float]]:
    goals = np.zeros((3, 2))
    choose_goals(state, heard, NOTHING, time, FLOOR, mind, goals)
    return goals.tolist()


def test_robots_that_know_nothing_search_the_squares_that_are_nearest_to_them() -> None:
    found = goals_of(state_of({}), heard_of({}), notes())
    assert found == [
        [0.0, 2.0],
        [0.0, 0.0],
        [0.0, 0.0],
    ]  # the first leaves the middle to the others
    assert goals_of(state_of({}), heard_of({}, radio=False), notes())[0] == [0.0, 0.0]


def test_the_nearest_robots_come_to_a_victim_that_one_tells_of() -> None:
    state, heard = state_of({(0, 0): WAITING}), heard_of({0: VICTIMS[0]})
    found = goals_of(state, heard, notes())
    assert found[0] == found[2] == [1.5, 1.5]
    assert found[1] != [1.5, 1.5]


def test_without_messages_only_the_finder_goes() -> None:
    found = goals_of(state_of({(0, 0): WAITING}), heard_of({}, radio=False), notes())
    assert found[0] == [1.5, 1.5]
    assert [1.5, 1.5] not in found[1:]


def test_a_robot_ignores_a_victim_that_it_has_seen_to_be_rescued() -> None:
    state = state_of({(0, 0): WAITING, (2, 0): RESCUED})
    assert goals_of(state, heard_of({0: VICTIMS[0]}), notes())[2] != [1.5, 1.5]


def test_each_robot_is_assigned_once_and_all_agree() -> None:
    heard = heard_of({})
    chosen = [assigned_victim(i, VICTIMS, heard, 2) for i in range(3)]
    assert chosen == [0, 1, 0]
    assert [assigned_victim(i, VICTIMS, heard, 1) for i in range(3)] == [0, 1, NO_INDEX]


def test_a_robot_gives_up_a_victim_for_a_while() -> None:
    state, mind = state_of({(0, 0): WAITING}), notes()
    state[:2] = VICTIMS[0]
    heard = heard_of({}, radio=False)
    heard[0, 0, [HEARD_X, HEARD_Y]] = VICTIMS[0]
    for time in range(20):
        assert goals_of(state, heard, mind, time)[0] == [1.5, 1.5]
    assert goals_of(state, heard, mind, 20)[0] != [1.5, 1.5]
    assert goals_of(state, heard, mind, 49)[0] != [1.5, 1.5]
    assert goals_of(state, heard, mind, 50)[0] == [1.5, 1.5]


def test_squares_that_others_see_are_not_searched_and_a_round_begins_anew() -> None:
    mind = notes()
    heard = heard_of({})
    heard[:, 1, [HEARD_X, HEARD_Y]] = [0.1, 0.1]
    goals_of(state_of({}), heard, mind)
    assert mind.looked_at[:, 1].all()
    assert not mind.looked_at[:, [0, 3]].any()
    mind.looked_at[:], mind.is_closed[3] = True, True
    goals_of(state_of({}), heard_of({}), mind)
    assert mind.looked_at.tolist() == [[False, False, False, True]] * 3
