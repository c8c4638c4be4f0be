"""Visits are counted where they were; free cells are those a robot can reach."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.analysis.visits import occupancy
from swarmdata.numerics.geometry import BOX
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import Arena, Role, TaskSpec
from swarmdata.types import Float

EMPTY = np.zeros((1, 0, 8), np.float32)


def team(n: int, width: float = 4.0, height: float = 3.0) -> TaskSpec:
    return TaskSpec(team=(Role(count=n),), arena=Arena(width=width, height=height))


def states_at(places: np.ndarray) -> Float:
    """States of robots at rest, [n, N, 2] -> [n, S]."""
    states = np.zeros((*places.shape[:2], N_COLUMNS), np.float32)
    states[..., :2] = places
    return states.reshape(len(places), -1)


def test_cells_count_from_the_lower_left() -> None:
    places = np.array([[(-1.95, -1.45), (0.05, 0.05)], [(1.95, 1.45), (0.05, 0.05)]])
    found = occupancy(states_at(places), EMPTY, team(2))
    assert found.visits.shape == (30, 40)
    assert found.visits[0, 0] == found.visits[29, 39] == 1
    assert found.visits[15, 20] == 2


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.floats(0.05, 0.7))
def test_every_visit_is_counted_once(seed: int, n_agents: int, cell: float) -> None:
    places = np.random.default_rng(seed).uniform(-1.6, 1.6, (30, n_agents, 2))
    spec = team(n_agents, 3.2, 3.2)
    found = occupancy(states_at(places), EMPTY, spec, cell)
    assert found.visits.sum() == 30 * n_agents
    assert 0.0 <= found.visited <= 1.0
    assert 0.0 <= found.entropy <= 1.0
    mixed = np.random.default_rng(seed).permutation(30)
    assert (occupancy(states_at(places[mixed]), EMPTY, spec, cell).visits == found.visits).all()


def test_walls_take_a_robots_radius() -> None:
    found = occupancy(states_at(np.zeros((1, 1, 2))), EMPTY, team(1))
    assert not found.free[0].any()  # 0.12 m of radius: the cell at the wall cannot hold a centre
    assert found.free[1, 1:-1].all()
    assert found.n_free == 28 * 38
    assert found.visited == pytest.approx(1 / found.n_free)
    assert found.entropy == 0.0


def test_what_stands_still_is_not_free_and_what_moves_is() -> None:
    boxes = np.zeros((2, 1, 8), np.float32)
    boxes[:, 0] = (BOX, 0.0, 0.0, 1.0, 0.0, 0.5, 0.5, 0.0)
    states = states_at(np.ones((1, 1, 2)))
    fixed = occupancy(states, boxes, team(1))
    assert not fixed.free[15, 20]
    assert fixed.free[15, 4]
    boxes[1, 0, 1] = 1.2
    assert occupancy(states, boxes, team(1)).free[15, 16]


def test_even_visits_have_evenness_one() -> None:
    spec = team(1)
    free = occupancy(states_at(np.zeros((1, 1, 2))), EMPTY, spec).free
    rows, columns = np.nonzero(free)
    places = np.stack([columns * 0.1 + 0.05 - 2.0, rows * 0.1 + 0.05 - 1.5], axis=1)
    found = occupancy(states_at(places[:, None]), EMPTY, spec)
    assert found.visited == 1.0
    assert found.entropy == pytest.approx(1.0)
    half = occupancy(states_at(places[: len(places) // 2, None]), EMPTY, spec)
    assert half.entropy == pytest.approx(math.log(len(places) // 2) / math.log(len(places)))
