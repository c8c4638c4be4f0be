"""What pursuers believe of evaders and of each other."""

import numpy as np
import pytest

from swarmdata.behavior_policies.heard_goals import HEARD_X, MASK, TARGET_X
from swarmdata.behavior_policies.pursuit.beliefs import (
    LOST_AGE,
    Beliefs,
    blank_beliefs,
    is_known,
    update_beliefs,
)
from swarmdata.envs.pursuit.sightings import CAPTURED, FREE
from swarmdata.types import Double, Float
from tests.behavior_policies.pursuit.hunts import NOTHING, hunt

SEES_ALL, LIMITED, TWO_EVADERS = hunt(2), hunt(2, is_limited=True), hunt(2, 2, is_limited=True)


def one(n_views: int = 2, n_evaders: int = 1) -> Beliefs:
    return Beliefs(*(array[0] for array in blank_beliefs(1, n_views, 2, n_evaders)))


def apart() -> Float:
    """Two robots out of sight of each other, and an evader near neither."""
    state = np.zeros(16 + 8 + 12, np.float32)
    state[8:10] = 3.0, 0.0
    return state


def silence() -> Double:
    heard = np.zeros((2, 2, 5))
    heard[[0, 1], [0, 1], MASK] = 1.0
    heard[1, 1, HEARD_X] = 3.0
    return heard


def message(heard: Double, place: tuple[float, float], target: tuple[float, float]) -> Double:
    """Robot 1 hears robot 0."""
    heard = heard.copy()
    heard[1, 0] = 1.0, *place, *target
    return heard


def test_a_team_that_sees_everything_knows_the_present() -> None:
    beliefs, c = one(n_views=1), SEES_ALL.columns
    state = apart()[:24]
    state[c.places : c.places + 2], state[c.velocities] = (1.0, 2.0), 0.5
    update_beliefs(state, silence(), NOTHING, SEES_ALL, beliefs)
    assert beliefs.places[0, 0].tolist() == [1.0, 2.0]
    assert beliefs.velocities[0, 0].tolist() == [0.5, 0.0]
    assert beliefs.mates[0].tolist() == [[0.0, 0.0], [3.0, 0.0]]
    assert is_known(beliefs, 0, 0)
    state[c.captured] = 1.0
    update_beliefs(state, silence(), NOTHING, SEES_ALL, beliefs)
    assert not is_known(beliefs, 0, 0)


def test_a_lost_evader_goes_on_more_and_more_slowly_until_it_is_forgotten() -> None:
    beliefs, state, c = one(), apart(), LIMITED.columns
    memory = state[c.memory : c.memory + 6]
    memory[:] = FREE, 0.5, 2.0, 0.8, 0.0, 0.0
    update_beliefs(state, silence(), NOTHING, LIMITED, beliefs)
    assert beliefs.ages[:, 0].tolist() == pytest.approx([0.0, LOST_AGE + 0.1])
    memory[5] = 0.1
    steps = []
    for _ in range(49):
        before = beliefs.places[0, 0, 0]
        update_beliefs(state, silence(), NOTHING, LIMITED, beliefs)
        steps.append(beliefs.places[0, 0, 0] - before)
        assert is_known(beliefs, 0, 0)
    assert steps[0] == pytest.approx(0.072, abs=1e-6)
    assert steps[1] == pytest.approx(0.9 * steps[0], abs=1e-6)
    for _ in range(2):
        update_beliefs(state, silence(), NOTHING, LIMITED, beliefs)
    assert not is_known(beliefs, 0, 0)


def test_an_evader_that_is_not_where_it_was_is_unknown() -> None:
    beliefs, state, c = one(), apart(), LIMITED.columns
    state[c.memory : c.memory + 6] = FREE, 0.5, 0.0, 0.0, 0.0, 0.0
    update_beliefs(state, silence(), NOTHING, LIMITED, beliefs)
    state[c.memory + 5] = 0.1
    seen = []
    for _ in range(5):
        update_beliefs(state, silence(), NOTHING, LIMITED, beliefs)
        seen.append(bool(is_known(beliefs, 0, 0)))
    assert seen == [True, True, False, False, False]


def test_messages_tell_where_an_evader_is_and_how_fast() -> None:
    beliefs, state = one(), apart()
    heard = message(silence(), (0.1, 0.2), (1.0, 1.0))
    update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    assert beliefs.mates[1, 0].tolist() == [0.1, 0.2]
    assert beliefs.places[1, 0].tolist() == [1.0, 1.0]
    assert beliefs.velocities[1, 0].tolist() == [0.0, 0.0]  # from one place, it says nothing
    heard = message(silence(), (0.1, 0.2), (1.05, 1.02))
    update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    np.testing.assert_allclose(beliefs.velocities[1, 0], [0.5, 0.2])
    assert beliefs.ages[1, 0] == pytest.approx(0.1)
    assert not is_known(beliefs, 0, 0)  # the sender's own memory says nothing
    for _ in range(50):  # the sender has lost it, and tells the same place
        assert is_known(beliefs, 1, 0)
        update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    assert not is_known(beliefs, 1, 0)


def test_a_sender_without_an_evader_tells_its_own_place() -> None:
    beliefs = one()
    heard = message(silence(), (0.1, 0.2), (0.1, 0.2))
    update_beliefs(apart(), heard, NOTHING, LIMITED, beliefs)
    assert not is_known(beliefs, 1, 0)


def test_sight_counts_more_than_messages_and_a_capture_is_remembered() -> None:
    beliefs, state, c = one(), apart(), LIMITED.columns
    memory = state[c.memory + 6 : c.memory + 12]
    memory[:] = FREE, 3.5, 0.0, 0.0, 0.0, 0.0
    heard = message(silence(), (0.0, 0.0), (1.0, 1.0))
    update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    assert beliefs.places[1, 0].tolist() == [3.5, 0.0]
    memory[0] = CAPTURED
    update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    heard[1, 0, TARGET_X] = 1.2
    update_beliefs(state, heard, NOTHING, LIMITED, beliefs)
    assert not is_known(beliefs, 1, 0)


def test_two_places_that_are_told_are_two_evaders() -> None:
    beliefs, state = one(n_evaders=2), np.zeros(16 + 16 + 24, np.float32)
    state[8:10] = 3.0, 0.0
    for target in ((1.0, 1.0), (-2.0, -2.0), (1.05, 1.0)):
        heard = message(silence(), (0.0, 0.0), target)
        update_beliefs(state, heard, NOTHING, TWO_EVADERS, beliefs)
    np.testing.assert_allclose(beliefs.places[1], [[1.05, 1.0], [-2.0, -2.0]])
