"""What robots remember of evaders."""

import numpy as np
import pytest

from swarmdata.envs.pursuit.sightings import (
    CAPTURED,
    FREE,
    UNKNOWN,
    Columns,
    Sighting,
    pursuit_columns,
    remember,
    sighting,
)
from swarmdata.numerics.geometry import CIRCLE
from swarmdata.registry.presets import preset
from swarmdata.types import Float

NOTHING = np.zeros((0, 8), np.float32)
PILLAR = np.array([[CIRCLE, 0.5, 0.0, 1.0, 0.0, 0.2, 0.2, 0.0]], np.float32)
LIMITED, FULL = Columns.of(2, 2, True), Columns.of(2, 2, False)


def state_of(columns: Columns) -> Float:
    """Two robots at (0, 0) and (0, 1), evaders at (1, 0) and (3, 0)."""
    state = np.zeros(16 + 8 * 2 + (24 if columns.memory >= 0 else 0), np.float32)
    state[8:10] = 0.0, 1.0
    state[columns.places : columns.captured] = 1.0, 0.0, 3.0, 0.0
    state[columns.velocities : columns.alarmed] = 0.5, 0.25, 0.0, 0.0
    return state


def test_robots_see_evaders_in_range_that_nothing_hides() -> None:
    state = state_of(LIMITED)
    remember(state, 0, PILLAR, 1.2, 0.1, LIMITED)
    assert sighting(state, 0, 0, LIMITED).status == UNKNOWN
    remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
    assert sighting(state, 0, 0, LIMITED) == Sighting(FREE, 1.0, 0.0, 0.5, 0.25, 0.0)
    assert sighting(state, 0, 1, LIMITED).status == UNKNOWN
    assert sighting(state, 1, 0, LIMITED).status == UNKNOWN


def test_robots_forget_after_five_seconds_what_they_do_not_see() -> None:
    state = state_of(LIMITED)
    remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
    state[LIMITED.places] = 1.5
    for step in range(49):
        remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
        known = sighting(state, 0, 0, LIMITED)
        assert (known.status, known.x) == (FREE, 1.0)
        assert known.age == pytest.approx(0.1 * (step + 1), abs=1e-5)
    remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
    assert sighting(state, 0, 0, LIMITED) == Sighting(UNKNOWN, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_robots_learn_of_a_capture_by_seeing_it_and_never_forget_it() -> None:
    state = state_of(LIMITED)
    remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
    state[LIMITED.captured] = 1.0
    remember(state, 0, PILLAR, 1.2, 0.1, LIMITED)
    assert sighting(state, 0, 0, LIMITED).status == FREE
    remember(state, 0, NOTHING, 1.2, 0.1, LIMITED)
    for _ in range(60):
        remember(state, 0, PILLAR, 1.2, 0.1, LIMITED)
    assert sighting(state, 0, 0, LIMITED).status == CAPTURED


def test_robots_that_see_everything_know_the_present() -> None:
    state = state_of(FULL)
    before = state.copy()
    remember(state, 1, PILLAR, 0.0, 0.1, FULL)
    np.testing.assert_array_equal(state, before)
    assert sighting(state, 1, 1, FULL) == Sighting(FREE, 3.0, 0.0, 0.0, 0.0, 0.0)
    state[FULL.captured + 1] = 1.0
    assert sighting(state, 1, 1, FULL).status == CAPTURED


@pytest.mark.parametrize(("name", "columns"), [("pursuit-sight", 3), ("pursuit-n6", 6)])
def test_every_column_has_its_name(name: str, columns: int) -> None:
    spec = preset(name)
    n_evaders = 2 if name == "pursuit-n6" else 1
    found = Columns.of(columns, n_evaders, name == "pursuit-sight")
    names = [column.name for column in pursuit_columns(spec, found)]
    first = 8 * columns
    assert names[found.captured - first] == "evader_0.captured"
    assert names[found.velocities - first] == "evader_0.vx"
    assert names[found.alarmed - first] == "evader_0.alarmed"
    assert names[found.headings - first] == "evader_0.ux"
    if found.memory >= 0:
        assert names[found.memory - first] == "robot_0.evader_0_known"
        assert names[-1] == "robot_2.evader_0_age"
    else:
        assert len(names) == 16
