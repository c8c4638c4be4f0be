"""Gaps of a payload to what is around it, against dense sampling and by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.envs.transport.payload import (
    CONTACT_GAP,
    Shape,
    count_contacts,
    count_pushes,
    obstacle_gap,
    payload_radius,
    payload_wall_gap,
    place_row,
    shape_of,
)
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, nearest, wall_gap
from swarmdata.specs.rules import Payload
from swarmdata.types import Double, Float

HALF = np.array([2.0, 1.5])
NOTHING = np.zeros((0, 8), dtype=np.float32)
BOX_SHAPE: Shape = (BOX, 0.35, 0.2)
DISC: Shape = (CIRCLE, 0.3, 0.3)

places = st.floats(-1.5, 1.5)
angles = st.floats(-math.pi, math.pi)
kinds = st.sampled_from([CIRCLE, BOX, CORNER, POCKET])


def body(x: float, y: float, angle: float = 0.0) -> Float:
    return np.array([x, y, 0, 0, math.cos(angle), math.sin(angle), 0], dtype=np.float32)


def row_of(pose: Float, shape: Shape) -> Float:
    row = np.empty(8, dtype=np.float32)
    place_row(pose, shape, row)
    return row


def obstacle(kind: float, x: float, y: float, angle: float) -> Float:
    b = 0.3 if kind == CIRCLE else 0.2
    return np.array([kind, x, y, math.cos(angle), math.sin(angle), 0.3, b, 0.05], np.float32)


def outline(pose: Float, shape: Shape, n: int = 400) -> Double:
    """Points of the payload's surface, dense, [n, 2]."""
    if shape[0] == CIRCLE:
        turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
        return pose[:2] + shape[1] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    a, b = shape[1], shape[2]
    corners = np.array([[a, b], [-a, b], [-a, -b], [a, -b], [a, b]])
    share = np.linspace(0, 1, n // 4, endpoint=False)[:, None]
    local = np.concatenate([p + share * (q - p) for p, q in pairwise(corners)])
    (ux, uy) = pose[4:6]
    turned = np.stack([local[:, 0] * ux - local[:, 1] * uy, local[:, 0] * uy + local[:, 1] * ux], 1)
    return pose[:2].astype(np.float64) + turned


@pytest.mark.slow
@settings(deadline=None, max_examples=150)
@given(places, places, angles, kinds, angles, st.sampled_from([BOX_SHAPE, DISC]))
def test_the_gap_to_an_obstacle_is_the_smallest_over_the_outline(
    x: float, y: float, angle: float, kind: float, turn: float, shape: Shape
) -> None:
    pose, other = body(x, y, angle), obstacle(kind, 0.1, -0.2, turn)
    points = outline(pose, shape)
    sampled = min(nearest(px, py, other)[0] for px, py in points)
    gap = obstacle_gap(row_of(pose, shape), other)
    if sampled > 0.0:
        assert gap == pytest.approx(sampled, abs=0.008)
    else:  # they overlap, though perhaps with no corner in the other
        assert gap < 0.35


@settings(deadline=None, max_examples=60)
@given(places, places, angles, st.sampled_from([BOX_SHAPE, DISC]))
def test_the_gap_to_a_wall_is_the_smallest_over_the_outline(
    x: float, y: float, angle: float, shape: Shape
) -> None:
    pose = body(x, y, angle)
    points = outline(pose, shape)
    for wall in range(4):
        sampled = min(wall_gap(px, py, HALF, wall) for px, py in points)
        gap = payload_wall_gap(row_of(pose, shape), HALF, wall)
        assert gap == pytest.approx(sampled, abs=1e-3)


def test_contacts_with_obstacles_and_walls_are_counted_when_they_begin() -> None:
    layout = obstacle(CIRCLE, 1.0, 0.0, 0.0)[None]
    touch = 0.4  # x at which the disc touches the obstacle
    ways = [0.0, touch, touch + 0.001, touch - CONTACT_GAP, touch - 0.1, touch, touch]
    bodies = np.stack([body(x, 0.0) for x in ways])
    assert count_contacts(bodies, DISC, layout, HALF) == 2
    assert count_contacts(bodies, DISC, NOTHING, HALF) == 0
    corner = np.stack([body(0.0, 0.0), body(1.7, 1.2), body(1.7, 1.2)])
    assert count_contacts(corner, DISC, NOTHING, HALF) == 2


def test_pushes_are_counted_per_robot_and_state() -> None:
    bodies = np.stack([body(0.0, 0.0), body(0.0, 0.0, math.pi / 2)])
    robots = np.array([[[0.0, -0.32], [0.0, 1.0]], [[0.0, -0.32], [0.0, -0.47]]], np.float32)
    radii = np.array([0.12, 0.12])
    # at first only robot 0 touches the long side; turned, robot 0 is inside and robot 1 touches
    assert count_pushes(robots, radii, bodies[:1], BOX_SHAPE) == 1
    assert count_pushes(robots[1:], radii, bodies[1:], BOX_SHAPE) == 2


def test_shapes_and_radii_follow_the_spec() -> None:
    box = Payload(shape="box", half_length=0.3, half_width=0.4)
    disc = Payload(shape="circle", half_length=0.3, half_width=9.0)
    assert shape_of(box) == (BOX, 0.3, 0.4)
    assert payload_radius(box) == pytest.approx(0.5)
    assert shape_of(disc) == (CIRCLE, 0.3, 0.3)
    assert payload_radius(disc) == 0.3
