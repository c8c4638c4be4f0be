"""Paths around a payload: they never cross it, and lead to the other side."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from swarmdata.behavior_policies.navigation.episode_maps import NODE_SPACING
from swarmdata.behavior_policies.transport.payload_detour import (
    N_POINTS,
    N_RING,
    RING_GAPS,
    Pushers,
    Rings,
    crosses,
    detour_waypoint,
    fill_rings,
)
from swarmdata.behavior_policies.transport.push_setup import PayloadState
from swarmdata.envs.transport.payload import Shape, place_row
from swarmdata.numerics.distance_field import Ground
from swarmdata.numerics.geometry import BOX, CIRCLE, nearest
from swarmdata.types import Double, Float

RADIUS = 0.12
BOX_SHAPE: Shape = (BOX, 0.35, 0.25)
DISC: Shape = (CIRCLE, 0.35, 0.35)
HALF = np.array([3.0, 3.0])
FREE: Float = np.full((121, 121), 0.9, dtype=np.float32)

angles = st.floats(-math.pi, math.pi)
places = st.floats(-1.2, 1.2)
shapes = st.sampled_from([BOX_SHAPE, DISC])


def body(angle: float = 0.0) -> Double:
    return np.array([0.1, -0.1, 0.0, 0.0, math.cos(angle), math.sin(angle), 0.0])


def gap(shape: Shape, pose: Double, x: float, y: float) -> float:
    row = np.empty(8, dtype=np.float32)
    place_row(pose, shape, row)
    return float(nearest(x, y, row)[0])


def rings_of(payload: PayloadState, grid: Float = FREE) -> Rings:
    rings = Rings(np.empty((N_POINTS, 2)), np.empty(N_POINTS, np.bool_))
    fill_rings(payload, RADIUS, Ground(grid, HALF, NODE_SPACING), rings)
    return rings


@settings(deadline=None)
@given(shapes, angles)
def test_rings_keep_their_gaps(shape: Shape, angle: float) -> None:
    pose = body(angle)
    points, free = rings_of(PayloadState(pose, shape))
    assert free.all()
    for k, (x, y) in enumerate(points):
        least = RADIUS + RING_GAPS[k // N_RING]
        assert least - 1e-6 <= gap(shape, pose, x, y) <= math.sqrt(2) * least + 1e-6


@pytest.mark.slow
@settings(deadline=None, max_examples=200)
@given(shapes, angles, places, places, places, places)
def test_a_line_crosses_where_its_points_come_near(
    shape: Shape, angle: float, x: float, y: float, u: float, v: float
) -> None:
    pose, margin = body(angle), 0.1
    assume(gap(shape, pose, x, y) > 0.15)
    assume(gap(shape, pose, u, v) > 0.15)
    share = np.linspace(0, 1, 300)[:, None]
    line = np.array([x, y]) + share * np.array([u - x, v - y])
    least = min(gap(shape, pose, *point) for point in line)
    found = crosses(PayloadState(pose, shape), (x, y), (u, v), margin)
    if least < 0.09:
        assert found
    if least > math.sqrt(2) * margin + 0.01:  # a box grows with its corners
        assert not found


def walk(
    shape: Shape, pose: Double, start: tuple[float, float], end: tuple[float, float], grid: Float
) -> Double:
    """Where a robot that follows the path is, every 0.05 m."""
    payload, ground = PayloadState(pose, shape), Ground(grid, HALF, NODE_SPACING)
    robots, rings = np.array([[*start]]), rings_of(payload, grid)
    pushers = Pushers(robots, np.zeros(1, np.bool_))
    path = [robots[0].copy()]
    for _ in range(200):
        found, x, y = detour_waypoint(0, pushers, end, payload, RADIUS, ground, rings)
        assert found
        step = np.array([x, y]) - robots[0]
        robots[0] += step * min(1.0, 0.05 / max(np.hypot(*step), 1e-9))
        path.append(robots[0].copy())
        if np.hypot(*(robots[0] - end)) < 1e-6:
            return np.array(path)
    raise AssertionError(f"did not arrive: {path[-1]}")


@settings(deadline=None, max_examples=40)
@given(shapes, angles, angles)
@example(BOX_SHAPE, 2.53125, 0.0625)  # ends beyond a corner
def test_it_leads_around_without_touching(shape: Shape, angle: float, side: float) -> None:
    pose = body(angle)
    away = np.array([math.cos(side), math.sin(side)])
    # every point 0.62 m away is outside the box that `crosses` grows, corners included
    start, end = pose[:2] + 1.2 * away, pose[:2] - 0.62 * away
    path = walk(shape, pose, (start[0], start[1]), (end[0], end[1]), FREE)
    assert min(gap(shape, pose, *point) for point in path) > RADIUS + 0.005
    assert 0.05 * len(path) < 1.8 + 1.0  # not much longer than straight through


def test_it_takes_the_free_side() -> None:
    grid = FREE.copy()
    grid[65:, :] = 0.0  # solid above y = 0.25: only below there is room
    path = walk(BOX_SHAPE, body(), (-1.0, 0.0), (0.9, -0.1), grid)
    assert path[:, 1].min() < -0.4
    assert path[:, 1].max() < 0.3


def test_it_passes_behind_robots_that_stand_at_the_payload() -> None:
    payload = PayloadState(body(), BOX_SHAPE)
    robots = np.array([[-0.9, -0.6], [-0.05, -0.47], [0.25, -0.47]])
    pushers = Pushers(robots, np.array([False, True, True]))
    ground, rings = Ground(FREE, HALF, NODE_SPACING), rings_of(payload)
    found, x, y = detour_waypoint(0, pushers, (0.75, -0.1), payload, RADIUS, ground, rings)
    assert found
    line = np.array([x, y]) - robots[0, :2]
    for other in robots[1:]:
        t = np.clip((other - robots[0]) @ line / (line @ line), 0, 1)
        assert np.hypot(*(robots[0] + t * line - other)) >= 2 * RADIUS


def test_without_room_there_is_no_path() -> None:
    payload, solid = PayloadState(body(), BOX_SHAPE), np.zeros((121, 121), dtype=np.float32)
    pushers, rings = (
        Pushers(np.array([[-1.0, 0.0]]), np.zeros(1, np.bool_)),
        rings_of(payload, solid),
    )
    assert not rings.is_free.any()
    ground = Ground(solid, HALF, NODE_SPACING)
    found, x, y = detour_waypoint(0, pushers, (0.9, 0.0), payload, RADIUS, ground, rings)
    assert not found
    assert (x, y) == pytest.approx((-1.0, 0.0))
