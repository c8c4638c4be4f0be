"""The floor of an intersection: gates, corners, arms, and where paths turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.intersection.junction import (
    ARM_DIRECTIONS,
    N_ARMS,
    STANDOFF_GAP,
    Junction,
    arm_at,
    next_corner,
)
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.presets import preset

BASE = preset("intersection")
HALF = np.array([2.0, 2.0])


def test_gates_are_on_the_right_hand_side_and_robots_fit_in_them() -> None:
    junction = Junction.of(BASE)
    for arm, direction in enumerate(ARM_DIRECTIONS):
        for gate, side in ((junction.entries[arm], -direction), (junction.exits[arm], direction)):
            right = np.array([side[1], -side[0]])
            assert gate @ right == pytest.approx(0.2)  # a quarter of the width
            assert gate @ direction == pytest.approx(2.0 - 0.12 - STANDOFF_GAP)
            assert clearance(*gate, junction.corners, HALF) >= 0.12 + STANDOFF_GAP - 1e-6


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_the_corners_are_what_is_outside_the_arms(x: float, y: float) -> None:
    junction = Junction.of(BASE)
    is_floor = min(abs(x), abs(y)) < 0.4
    at_edge = abs(min(abs(x), abs(y)) - 0.4) < 1e-5
    inside = clearance(x, y, junction.corners, np.array([9.0, 9.0])) <= 0.0
    assert at_edge or inside != is_floor


def test_each_gate_is_in_its_arm() -> None:
    junction = Junction.of(BASE)
    for arm in range(N_ARMS):
        assert arm_at(*junction.entries[arm]) == arm_at(*junction.exits[arm]) == arm


@given(st.integers(0, 3), st.integers(0, 3))
def test_a_path_from_gate_to_gate_turns_once_at_most_and_hits_nothing(start: int, end: int) -> None:
    junction = Junction.of(BASE)
    at, goal = junction.entries[start], junction.exits[end]
    corner = np.array(next_corner(*at, *goal, junction.half_width))
    if start % 2 == end % 2:
        np.testing.assert_array_equal(corner, goal)
        return
    assert np.abs(corner).max() == pytest.approx(0.2)
    for a, b in ((at, corner), (corner, goal)):
        assert 0.0 in np.abs(b - a).round(9)  # along an axis
        for share in np.linspace(0, 1, 30):
            point = a + share * (b - a)
            assert clearance(*point, junction.corners, HALF) >= 0.12
    np.testing.assert_array_equal(next_corner(*corner, *goal, junction.half_width), goal)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"arm_width": 0.5}, "arm_width is 0.5 m, expected at least 0.68 m"),
        ({"arm_width": 3.2}, "arms would be 0.4 m long, expected at least 0.5 m"),
    ],
)
def test_floors_without_room_are_refused(changes: dict[str, float], message: str) -> None:
    spec = BASE.with_updates(rules={"task": "intersection", **changes})
    with pytest.raises(SpecError, match=message):
        Junction.of(spec)
