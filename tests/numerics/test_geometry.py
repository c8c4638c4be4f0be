"""Distances to obstacles against dense samples of their outlines."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.physics.public_backend import bars
from swarmdata.numerics.geometry import (
    CIRCLE,
    bounding_radius,
    clearance,
    nearest,
    nearest_of,
    outer_radius,
)
from swarmdata.types import Double, Float

coordinate = st.floats(-2, 2)


@st.composite
def obstacles(draw: st.DrawFn) -> Float:
    kind, angle = draw(st.sampled_from([0.0, 1.0, 2.0, 3.0])), draw(st.floats(0, 6.28))
    a, b = draw(st.floats(0.2, 0.4)), draw(st.floats(0.2, 0.4))
    b = a if kind == CIRCLE else b
    x, y = draw(st.floats(-1, 1)), draw(st.floats(-1, 1))
    return np.array([kind, x, y, np.cos(angle), np.sin(angle), a, b, 0.05], dtype=np.float32)


def outline(row: Float) -> Double:
    """Points on the surface, about 1 mm apart."""
    if row[0] == CIRCLE:
        angle = np.linspace(0, 2 * np.pi, 4000)
        return row[1:3] + row[5] * np.stack([np.cos(angle), np.sin(angle)], -1)
    corners = np.empty((3, 4, 2))
    n_bars = bars(row, corners)
    share = np.linspace(0, 1, 1000)[:, None]
    edges = [
        bar[k] * (1 - share) + bar[(k + 1) % 4] * share
        for bar in corners[:n_bars]
        for k in range(4)
    ]
    return np.concatenate(edges)


@given(row=obstacles(), x=coordinate, y=coordinate)
def test_distance_and_vector_lead_to_the_nearest_surface_point(
    row: Float, x: float, y: float
) -> None:
    distance, vx, vy = nearest(x, y, row)
    brute = np.linalg.norm(outline(row) - [x, y], axis=-1).min()
    if distance == 0:  # inside
        assert brute <= 0.45
        return
    assert abs(distance - brute) < 2e-3
    assert abs(np.hypot(vx, vy) - distance) < 1e-6
    assert nearest(x + vx, y + vy, row)[0] < 1e-6


@given(row=obstacles())
def test_the_bounding_circle_holds_the_outline(row: Float) -> None:
    reach = np.linalg.norm(outline(row) - row[1:3], axis=-1).max()
    assert abs(reach - bounding_radius(row)) < 2e-3


@given(row=obstacles(), x=coordinate, y=coordinate)
def test_clearance_is_the_least_of_obstacles_and_walls(row: Float, x: float, y: float) -> None:
    expected = min(nearest(x, y, row)[0], 2 - abs(x), 2 - abs(y))
    assert abs(clearance(x, y, row[None], np.array([2.0, 2.0])) - expected) < 1e-12


@given(row=obstacles())
def test_corners_start_at_the_smallest_and_run_counter_clockwise(row: Float) -> None:
    corners = np.empty((3, 4, 2))
    for bar in corners[: bars(row, corners)]:
        assert tuple(bar[0]) == min(map(tuple, bar))
        nxt = np.roll(bar, -1, axis=0)
        assert (bar[:, 0] * nxt[:, 1] - bar[:, 1] * nxt[:, 0]).sum() > 0


@given(rows=st.lists(obstacles(), min_size=1, max_size=4), x=coordinate, y=coordinate)
def test_nearest_of_a_layout_is_nearest_of_its_row(rows: list[Float], x: float, y: float) -> None:
    layout = np.stack(rows)
    for m, row in enumerate(rows):
        assert nearest_of(x, y, layout, m) == nearest(x, y, row)


@given(row=obstacles())
def test_the_outer_radius_holds_the_obstacle_and_little_more(row: Float) -> None:
    exact, outer = bounding_radius(row), outer_radius(row)
    assert exact <= outer <= 1.4144 * exact
