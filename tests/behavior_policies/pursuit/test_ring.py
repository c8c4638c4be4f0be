"""The ring: slots, the order in which they are taken, the way there, and when it closes."""

import numpy as np
import pytest

from swarmdata.behavior_policies.pursuit.ring import (
    COMMITTED_STEPS,
    PATIENCE_STEPS,
    RING_RADIUS,
    assign_slots,
    decides_to_close,
    guarded_cos,
    ring_goals,
    travel,
    turn_order,
)
from swarmdata.types import Double
from tests.behavior_policies.pursuit.hunts import NOTHING, hunt

HUNT, MIDDLE = hunt(3, captors=3), np.zeros(2)


def around(*degrees: float, radius: float = RING_RADIUS) -> Double:
    angles = np.radians(degrees)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def test_slots_are_even_in_the_open_and_taken_in_the_order_of_the_robots() -> None:
    members, slots = around(200, 80, -40), np.empty((3, 2))
    assign_slots(MIDDLE, members, RING_RADIUS, NOTHING, HUNT, slots)
    np.testing.assert_allclose(np.linalg.norm(slots, axis=1), RING_RADIUS)
    apart = np.linalg.norm(slots[:, None] - slots, axis=-1)[np.triu_indices(3, 1)]
    np.testing.assert_allclose(apart, RING_RADIUS * 3**0.5, atol=0.13)
    assert (np.linalg.norm(slots - members, axis=1) < 0.3).all()


def test_near_a_wall_slots_are_in_the_open_half() -> None:
    place, slots = np.array([3.7, 0.0]), np.empty((3, 2))
    assign_slots(place, around(0, 120, 240) + place, RING_RADIUS, NOTHING, HUNT, slots)
    assert (np.abs(slots) <= 3.9).all()
    assert (slots[:, 0] < 3.8).all()


def test_members_are_ordered_by_the_angle_at_which_they_stand() -> None:
    degrees = np.array([10.0, 300.0, 100.0, 190.0, 91.0])
    order = turn_order(MIDDLE, around(*degrees))
    assert degrees[order].tolist() == sorted(degrees)


def test_a_direction_is_guarded_by_the_nearest_robot_within_reach() -> None:
    cos = guarded_cos(MIDDLE, around(0, 90, 180, 270), NOTHING, HUNT)
    assert cos == pytest.approx(np.cos(np.radians(45)), abs=1e-6)
    assert guarded_cos(MIDDLE, around(0, 90, 180, 270, radius=1.3), NOTHING, HUNT) == -1.0
    corner = np.array([3.85, 3.85])  # two walls guard the rest
    assert guarded_cos(corner, corner + around(225), NOTHING, HUNT) > 0.6


def test_a_robot_travels_along_the_circle() -> None:
    out = np.empty(2)
    travel(MIDDLE, around(0)[0], around(170)[0], HUNT, out)
    np.testing.assert_allclose(out, around(np.degrees(0.6))[0])
    travel(MIDDLE, around(0)[0], around(-170)[0], HUNT, out)
    np.testing.assert_allclose(out, around(-np.degrees(0.6))[0])
    travel(MIDDLE, around(0, radius=2.0)[0], around(170)[0], HUNT, out)
    assert np.linalg.norm(out) == pytest.approx(RING_RADIUS + 0.3)
    travel(MIDDLE, around(0)[0], around(30)[0], HUNT, out)
    np.testing.assert_allclose(out, around(30)[0])


def test_the_ring_waits_closes_and_opens() -> None:
    assert decides_to_close(False, 0, 0.4, False) == (True, 0)  # all directions are guarded
    is_closing, wait = False, 0
    for step in range(PATIENCE_STEPS):
        assert (is_closing, wait) == (False, step)
        is_closing, wait = decides_to_close(is_closing, wait, -1.0, True)
    assert is_closing
    assert decides_to_close(False, 5, -1.0, False) == (False, 0)
    count = 0
    while is_closing:
        is_closing, wait = decides_to_close(is_closing, wait, -1.0, True)
        count += 1
    assert count == COMMITTED_STEPS
    assert decides_to_close(True, -50, 0.0, True)[0]


def test_a_ring_that_closes_drives_at_the_evader() -> None:
    members, goals = around(0, 120, 240, radius=0.8), np.empty((3, 2))
    velocity = np.array([0.2, 0.0])
    assert ring_goals(MIDDLE, velocity, members, (False, 0), NOTHING, HUNT, goals) == (True, 0)
    assert (np.linalg.norm(goals - [0.06, 0.0], axis=1) < 0.26).all()
    members *= 0.5
    ring_goals(MIDDLE, velocity, members, (True, 0), NOTHING, HUNT, goals)
    np.testing.assert_allclose(goals, [[0.03, 0.0]] * 3)
    far = around(0, 10, 20, radius=2.0)
    assert not ring_goals(MIDDLE, velocity, far, (False, 0), NOTHING, HUNT, goals)[0]
    assert (np.linalg.norm(goals, axis=1) > 0.9).all()
