"""Waypoints around a pocket, on a map."""

import numpy as np
import pytest

from swarmdata.numerics.distance_field import Ground, grid_shape
from swarmdata.numerics.geometry import POCKET, clearance
from swarmdata.numerics.waypoints import (
    UNPLANNED_COST,
    Paths,
    free_distance,
    is_visible,
    waypoint,
)
from tests.support.grounds import HALF, SPACING, SPEC, ground_of, layout_of

POCKET_ROW = np.array([[POCKET, 0.0, 0.0, 0.0, 1.0, 0.4, 0.4, 0.05]], dtype=np.float32)
"""A pocket that opens towards -x."""


def unplanned(n_nodes: int) -> Paths:
    return Paths(np.full(n_nodes, UNPLANNED_COST, np.int32), np.zeros(n_nodes, np.int32))


def test_interpolated_clearance_is_close() -> None:
    layout = layout_of(0)
    ground = ground_of(layout)
    for x, y in np.random.default_rng(0).uniform(-1.99, 1.99, size=(400, 2)):
        expected = min(clearance(x, y, layout, HALF), 0.27)
        assert free_distance(x, y, ground) == pytest.approx(expected, abs=0.02)


def test_a_wall_hides_and_an_opening_does_not() -> None:
    ground = ground_of(POCKET_ROW)
    assert not is_visible((-1.0, 0.0), (1.0, 0.0), 0.135, ground)
    assert is_visible((-1.0, 0.0), (0.0, 0.0), 0.135, ground)
    assert is_visible((-1.0, 1.0), (1.0, 1.0), 0.135, ground)


def test_waypoints_lead_out_of_a_pocket_without_touching_it() -> None:
    ground = ground_of(POCKET_ROW)
    paths = unplanned(ground.clearances.size)
    x, y, goal = 0.1, 0.0, np.array([1.2, 0.0])
    first = waypoint((x, y), goal, 0.12, ground, paths)
    assert first[0] < -0.3  # out of the mouth first
    for _ in range(200):
        to_x, to_y = waypoint((x, y), goal, 0.12, ground, paths)
        d = float(np.hypot(to_x - x, to_y - y))
        step = min(0.05, d) / max(d, 1e-9)
        x, y = x + step * (to_x - x), y + step * (to_y - y)
        assert clearance(x, y, POCKET_ROW, HALF) > 0.12
    assert (x, y) == pytest.approx((1.2, 0.0), abs=1e-6)


def test_without_a_path_the_goal_is_aimed_at() -> None:
    grid = np.zeros(grid_shape(SPEC.arena, SPACING), dtype=np.float32)
    grid[40, 20] = 0.3
    ground, goal = Ground(grid, HALF, SPACING), np.array([1.0, 1.0])
    assert waypoint((-1.0, 0.0), goal, 0.12, ground, unplanned(grid.size)) == (1.0, 1.0)
