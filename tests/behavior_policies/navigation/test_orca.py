"""The velocity programs against brute force, and the half-planes against their definition."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.behavior_policies.navigation.orca import (
    damper_half_plane,
    least_violating,
    robot_half_plane,
    solve,
)
from swarmdata.types import Double

LIMIT = 0.6
AXIS = np.linspace(-LIMIT, LIMIT, 121)
GRID = np.stack(np.meshgrid(AXIS, AXIS), axis=-1).reshape(-1, 2)
GRID = GRID[(GRID**2).sum(axis=1) <= LIMIT**2]

component = st.floats(-0.5, 0.5, allow_nan=False)
half_plane = st.tuples(component, component, st.floats(0.0, 6.283))


def planes_of(rows: list[tuple[float, float, float]]) -> Double:
    return np.array([(x, y, math.cos(angle), math.sin(angle)) for x, y, angle in rows])


def violations(planes: Double, velocities: Double) -> Double:
    """How far each velocity is outside each half-plane, [V, K]."""
    offset = planes[None, :, :2] - velocities[:, None, :]
    return planes[:, 2] * offset[..., 1] - planes[:, 3] * offset[..., 0]


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(st.lists(half_plane, min_size=1, max_size=6), component, component)
def test_solve_against_a_grid_of_velocities(
    rows: list[tuple[float, float, float]], x: float, y: float
) -> None:
    planes, aim = planes_of(rows), np.array([x, y])
    found = np.array(solve(planes, len(planes), 0, LIMIT, (x, y)))
    assert math.hypot(*found) <= LIMIT + 1e-9
    worst = float(violations(planes, found[None]).max())
    on_grid = violations(planes, GRID).max(axis=1)
    safe = GRID[on_grid <= 0.0]
    if len(safe):  # feasible: safe, and no farther from the aim than any safe velocity of the grid
        assert worst <= 1e-7
        best = np.sqrt(((safe - aim) ** 2).sum(axis=1)).min()
        assert math.hypot(*(found - aim)) <= best + 1e-7
    else:  # infeasible: no velocity of the grid violates its worst half-plane less
        assert worst <= max(on_grid.min(), 0.0) + 1e-6


@settings(deadline=None, max_examples=100)
@given(st.lists(half_plane, min_size=1, max_size=4))
def test_hard_half_planes_hold_when_soft_ones_cannot(
    rows: list[tuple[float, float, float]],
) -> None:
    hard = planes_of([(0.1, 0.0, math.pi / 2)])  # vx <= 0.1
    contradiction = planes_of([(0.3, 0.0, -math.pi / 2)])  # vx >= 0.3
    planes = np.concatenate([hard, planes_of(rows), contradiction])
    vx, _ = solve(planes, len(planes), 1, LIMIT, (0.5, 0.0))
    assert vx <= 0.1 + 1e-9


def test_two_opposed_half_planes_are_violated_equally() -> None:
    planes = planes_of([(-0.2, 0.0, math.pi / 2), (0.2, 0.0, -math.pi / 2)])
    vx, _ = least_violating(planes, 2, 0, 1, LIMIT, (-0.2, 0.0))
    assert vx == pytest.approx(0.0, abs=1e-9)


def test_damper_bounds_the_approach_speed() -> None:
    out = np.empty((1, 4))
    damper_half_plane(0.6, 0.8, 0.25, out[0])
    outside = violations(out, np.array([[0.6, 0.8], [0.0, 0.0], [-0.8, 0.6]]))
    np.testing.assert_allclose(outside[:, 0], (0.75, -0.25, -0.25), atol=1e-12)


angle = st.floats(0.0, 6.283)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(angle, st.floats(0.35, 1.5), angle, st.floats(0, LIMIT), angle, st.floats(0, LIMIT))
def test_two_robots_that_both_obey_stay_apart(
    bearing: float,
    distance: float,
    heading_1: float,
    speed_1: float,
    heading_2: float,
    speed_2: float,
) -> None:
    reach, rule = 0.27, (1.0, 0.6, 0.5)
    x, y = distance * math.cos(bearing), distance * math.sin(bearing)
    v1 = (speed_1 * math.cos(heading_1), speed_1 * math.sin(heading_1))
    v2 = (speed_2 * math.cos(heading_2), speed_2 * math.sin(heading_2))
    planes = np.empty((2, 4))
    robot_half_plane((x, y), v1, v2, reach, rule, planes[0])
    robot_half_plane((-x, -y), v2, v1, reach, rule, planes[1])
    new_1 = np.array(solve(planes[:1], 1, 0, 10.0, v1))
    new_2 = np.array(solve(planes[1:], 1, 0, 10.0, v2))
    times = np.linspace(0.0, 1.0, 101)[:, None]
    apart = np.array([x, y]) + times * (new_2 - new_1)
    assert np.sqrt((apart**2).sum(axis=1)).min() >= reach - 1e-6


def test_an_overlap_is_left_even_at_the_same_velocity() -> None:
    plane = np.empty((1, 4))
    robot_half_plane((0.1, 0.0), (0.1 / 0.6, 0.0), (0.0, 0.0), 0.27, (1.0, 0.6, 1.0), plane[0])
    vx, vy = solve(plane, 1, 0, LIMIT, (0.1 / 0.6, 0.0))
    assert vx < 0.0
    assert math.isfinite(vy)
