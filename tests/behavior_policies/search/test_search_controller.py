"""The scripted controller of `search`: what it reads of messages, and that teams rescue."""

import numpy as np

from swarmdata.behavior_policies.heard_goals import HEARD_X, HEARD_Y, MASK, HeardGoals
from swarmdata.behavior_policies.search.search_controller import (
    NO_INDEX,
    VICTIM_X,
    VICTIM_Y,
    Floor,
    Notes,
    SearchController,
    assigned_victim,
    choose_goals,
    observed_square,
)
from swarmdata.envs.search.floor_memory import RESCUED, WAITING, Columns
from swarmdata.envs.search.search import Search
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.types import Double, Float

SPEC = preset("search")


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


def test_robots_that_take_no_notes_decide_the_same_whatever_was_before() -> None:
    env, copies = make_env(SPEC, 4), np.arange(4)
    settled, fresh = (SearchController(SPEC, remembers=False) for _ in range(2))
    step = env.reset(np.arange(4, dtype=np.uint64))
    settled.reset(step, copies)
    for _ in range(60):
        fresh.reset(step, copies)
        actions = settled.act(step)
        np.testing.assert_array_equal(actions, fresh.act(step))
        step = env.step(actions)


def test_robots_that_take_no_notes_search_what_they_observe_and_nobody_is_nearer_to() -> None:
    env = make_env(SPEC, 8)
    controller = SearchController(SPEC, remembers=False)
    step = env.reset(np.arange(8, dtype=np.uint64))
    controller.reset(step, np.arange(8))
    heard, names = (
        HeardGoals(Search(SPEC)).of(step),
        [each.name for each in features_of(Search(SPEC))],
    )
    middles = controller._floor.middles
    for b, i in np.ndindex(8, 4):
        offsets = step.observations[b, i, [names.index(f"unsearched_{k}.offset_{axis}")
                                           for k in range(4) for axis in "xy"]]  # fmt: skip
        nearer = step.observations[b, i, [names.index(f"unsearched_{k}.offset_way_nearer")
                                          for k in range(4)]]  # fmt: skip
        chosen = observed_square(i, step.states[b], heard[b], controller._floor)
        slot = np.flatnonzero(nearer == 0.0)[0] if (nearer == 0.0).any() else 0
        expected = heard[b, i, i, HEARD_X : HEARD_Y + 1] + offsets[2 * slot : 2 * slot + 2]
        np.testing.assert_allclose(middles[chosen], expected, atol=1e-5)
