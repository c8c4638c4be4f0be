"""What robots remember of the floor and of victims."""

import numpy as np
import pytest

from swarmdata.envs.search.floor_memory import (
    Columns,
    cell_middles,
    close_cells,
    find_unsearched,
    look,
)
from swarmdata.envs.search.search_rules import SearchRules
from swarmdata.numerics.geometry import BOX
from swarmdata.registry.presets import preset
from swarmdata.types import Double, Float

MIDDLES = np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
COLUMNS = Columns.of(2, 1, 3)
WALL = np.array([[BOX, 0.5, 0.0, 1.0, 0.0, 0.05, 0.5, 0.0]], np.float32)
NOTHING = np.zeros((0, 8), np.float32)


def state_of(*places: tuple[float, float], victim: tuple[float, float] = (9.0, 9.0)) -> Float:
    state = np.zeros(COLUMNS.searched + 2 * 3, np.float32)
    for i, place in enumerate(places):
        state[8 * i : 8 * i + 2] = place
    state[COLUMNS.victims : COLUMNS.rescued] = victim
    return state


def test_squares_cover_the_arena_and_the_last_ones_are_cut_off() -> None:
    spec = preset("search").with_updates(arena={"width": 2.0, "height": 1.5})
    middles = cell_middles(spec, SearchRules(cell_size=0.75))
    expected: Double = np.array([[x, y] for y in (-0.375, 0.375) for x in (-0.625, 0.125, 0.75)])
    np.testing.assert_allclose(middles, expected)


@pytest.mark.parametrize(
    ("layout", "sight_range", "searched"),
    [(NOTHING, 1.5, [1, 1, 1]), (NOTHING, 0.5, [0, 1, 0]), (WALL, 1.5, [1, 1, 0])],
)
def test_a_square_is_searched_once_its_middle_is_seen(
    layout: Float, sight_range: float, searched: list[int]
) -> None:
    state = state_of((0.1, 0.0), (9.0, 9.0))
    assert look(state, 0, layout, MIDDLES, sight_range, COLUMNS) == (0, sum(searched))
    first = COLUMNS.searched
    assert state[first : first + 3].tolist() == searched
    assert not state[first + 3 :].any()  # the other robot has seen nothing
    assert look(state, 0, layout, MIDDLES, sight_range, COLUMNS) == (0, 0)


def test_squares_that_nobody_can_reach_are_closed() -> None:
    state = state_of((0.0, 0.0), (0.0, 0.0))
    wall = WALL.copy()
    wall[0, 1] = 1.0
    close_cells(state, wall, MIDDLES, np.array([2.0, 2.0]), 0.12, COLUMNS)
    assert state[COLUMNS.searched :].tolist() == [0, 0, 1] * 2


@pytest.mark.parametrize("n_slots", [1, 2, 4])
def test_the_nearest_squares_that_are_left_are_named(n_slots: int) -> None:
    state, slots = state_of((0.0, 0.0), (0.0, 0.0)), np.zeros(n_slots, np.int64)

    def found(i: int, x: float) -> list[int]:
        count = find_unsearched(state, i, x, 0.0, MIDDLES, COLUMNS, slots)
        assert count <= n_slots
        return slots[:count].tolist()

    assert found(0, 0.8) == [2, 1, 0][:n_slots]
    assert found(0, -0.3) == [1, 0, 2][:n_slots]
    state[COLUMNS.searched + 2] = 1.0
    assert found(0, 0.8) == [1, 0][:n_slots]
    assert found(1, 0.8) == [2, 1, 0][:n_slots]
    state[COLUMNS.searched : COLUMNS.searched + 3] = 1.0
    assert found(0, 0.8) == []
