"""Who takes which slot, who is in its slot, and how hard the robots push."""

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from swarmdata.behavior_policies.navigation.episode_maps import NODE_SPACING
from swarmdata.behavior_policies.transport.push_setup import PayloadState, PushSetup
from swarmdata.behavior_policies.transport.push_slots import (
    ARC_MIN_COSINE,
    MAX_SLOTS,
    NO_INDEX,
    SlotSearch,
    choose_slots,
    face_normal,
)
from swarmdata.behavior_policies.transport.push_team import (
    SWAP_MIN_GAIN,
    assign_slots,
    contact,
    feasible_direction,
    push_forces,
    stands,
)
from swarmdata.envs.transport.payload import Shape
from swarmdata.numerics.distance_field import Ground
from swarmdata.numerics.geometry import BOX, CIRCLE
from swarmdata.registry.presets import preset
from swarmdata.specs.rules import Payload
from swarmdata.types import Double, Float, Int

RADIUS, REACH = 0.12, 0.35
BOX_SHAPE: Shape = (BOX, 0.35, 0.25)
DISC: Shape = (CIRCLE, REACH, REACH)
HALF = np.array([3.0, 3.0])
FREE: Float = np.full((121, 121), 0.9, dtype=np.float32)
SETUP = PushSetup.of(preset("transport"), Payload())._replace(
    moved_mass=8.0, friction=2.5, robot_force=1.5, held_torque=0.4
)

angles = st.floats(-math.pi, math.pi)
shapes = st.sampled_from([BOX_SHAPE, DISC])


def unit(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def body(x: float = 0.0, y: float = 0.0, angle: float = 0.0) -> Double:
    return np.array([x, y, 0.0, 0.0, *unit(angle), 0.0])


def search_of(
    shape: Shape, pose: Double, direction: tuple[float, float], n: int = 4, grid: Float = FREE
) -> SlotSearch:
    return SlotSearch(
        PayloadState(pose, shape), direction, Ground(grid, HALF, NODE_SPACING), n, RADIUS, 1.75
    )


def slots_for(
    shape: Shape, pose: Double, direction: tuple[float, float], n: int = 4
) -> tuple[int, int, Double]:
    out = np.empty((MAX_SLOTS, 4))
    first, second, k = choose_slots(search_of(shape, pose, direction, n), (NO_INDEX, NO_INDEX), out)
    return first, second, out[:k]


@settings(deadline=None)
@given(shapes, angles, angles, st.integers(2, 6))
def test_slots_touch_the_payload_and_keep_robots_apart(
    shape: Shape, angle: float, direction: float, n: int
) -> None:
    pose = body(0.3, -0.2, angle)
    _, _, slots = slots_for(shape, pose, unit(direction), n)
    assert 2 <= len(slots) <= n
    for slot in slots:
        push = slot[2:]
        assert np.hypot(*push) == pytest.approx(1.0)
        assert push @ unit(direction) > 0.08  # none works against the direction
        offset = slot[:2] - pose[:2]
        if shape is DISC:
            assert push @ unit(direction) >= ARC_MIN_COSINE - 1e-9
            np.testing.assert_allclose(offset, -(REACH + RADIUS) * push, atol=1e-9)
        else:
            local = np.array([offset @ unit(angle), offset @ unit(angle + math.pi / 2)])
            beyond = np.maximum(np.abs(local) - [0.35, 0.25], 0.0)
            assert np.hypot(*beyond) == pytest.approx(RADIUS)
    for a in range(len(slots)):
        for b in range(a):
            assert np.hypot(*(slots[a, :2] - slots[b, :2])) > 2 * RADIUS + 0.02


@settings(deadline=None)
@given(angles, angles)
def test_the_faces_point_along_the_direction_and_can_move_the_payload(
    angle: float, direction: float
) -> None:
    pose = body(angle=angle)
    first, second, slots = slots_for(BOX_SHAPE, pose, unit(direction))
    ahead = np.array(face_normal(pose, first)) @ unit(direction)
    assert ahead >= math.cos(math.pi / 4) - 1e-9
    if second != NO_INDEX:
        assert np.array(face_normal(pose, second)) @ unit(direction) > 0.2
        assert face_normal(pose, first) != face_normal(pose, second)
    out = np.empty(len(slots))
    assert push_forces(pose, feasible_direction(unit(direction), slots), slots, SETUP, out)


def test_a_face_at_a_surface_is_not_used() -> None:
    grid = FREE.copy()
    grid[:, :60] = 0.0  # something solid left of x = 0
    out = np.empty((MAX_SLOTS, 4))
    pose = body(0.4)
    search = search_of(BOX_SHAPE, pose, (1.0, 0.1), grid=grid)
    first, _, k = choose_slots(search, (NO_INDEX, NO_INDEX), out)
    assert first == 2  # the push along +x has no room; the next best is along +y
    assert k >= 2
    assert (out[:k, 0] > 0.0).all()


def test_a_small_change_of_the_direction_keeps_the_faces() -> None:
    pose, out = body(), np.empty((MAX_SLOTS, 4))
    before = (0, 2)
    for degrees in (20.0, 40.0, 50.0, 70.0):
        direction = unit(math.radians(degrees))
        kept = choose_slots(search_of(BOX_SHAPE, pose, direction), before, out)
        assert set(kept[:2]) == {0, 2}
        assert kept[:2] == before


def brute_force(robots: Double, slots: Double) -> float:
    goals = slots[:, :2] - 0.03 * slots[:, 2:]
    return min(
        sum(float(((robots[i] - goals[s]) ** 2).sum()) for s, i in enumerate(chosen))
        for chosen in permutations(range(len(robots)), len(slots))
    )


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), angles)
def test_slots_are_taken_once_and_paths_are_short(seed: int, direction: float) -> None:
    rng = np.random.default_rng(seed)
    _, _, slots = slots_for(DISC, body(), unit(direction), 5)
    behind = -np.array(unit(direction))
    robots = behind * 1.5 + rng.uniform(-0.7, 0.7, (5, 2))  # all see all slots
    out: Int = np.full(5, NO_INDEX)
    assign_slots(robots, PayloadState(body(), DISC), slots, 0.0, out)
    taken = sorted(out[out >= 0].tolist())
    assert taken == list(range(len(slots)))
    goals = slots[:, :2] - 0.03 * slots[:, 2:]
    total = sum(float(((robots[i] - goals[s]) ** 2).sum()) for i, s in enumerate(out) if s >= 0)
    assert total <= 1.5 * brute_force(robots, slots) + len(slots) * SWAP_MIN_GAIN
    again = out.copy()
    assign_slots(robots, PayloadState(body(), DISC), slots, 0.0, again)
    np.testing.assert_array_equal(again, out)  # what is assigned stays


@settings(deadline=None)
@given(angles, st.floats(-0.05, 0.05), st.floats(-0.04, 0.04), shapes)
def test_errors_of_a_slot_are_to_the_left_and_ahead(
    direction: float, left: float, ahead: float, shape: Shape
) -> None:
    _, _, slots = slots_for(shape, body(), unit(direction))
    slot = slots[0]
    nx, ny = slot[2:]
    robot = slot[:2] - ahead * slot[2:] - left * np.array([-ny, nx])
    px, py, found_left, found_ahead = contact(robot, 0.0, PayloadState(body(), shape), slot)
    assert math.hypot(px, py) == pytest.approx(1.0)
    assert found_left == pytest.approx(left, abs=0.01)
    assert found_ahead == pytest.approx(ahead, abs=0.005)
    assert stands(found_left, found_ahead, False, False)
    assert not stands(0.0, 0.2, True, True)


@settings(deadline=None)
@given(angles, st.integers(2, 6), shapes, st.floats(0, 0.3))
def test_forces_are_within_limits_and_along_the_direction(
    direction: float, n: int, shape: Shape, speed: float
) -> None:
    pose = body(angle=0.3)
    pose[2], pose[3] = speed * np.array(unit(direction))
    _, _, slots = slots_for(shape, pose, unit(direction), n)
    possible = feasible_direction(unit(direction), slots)
    out = np.empty(len(slots))
    assume(push_forces(pose, possible, slots, SETUP, out))
    assert (out >= 0).all()
    assert (out <= 1.5 + 1e-9).all()
    force = out @ slots[:, 2:]
    assert force @ np.array(possible) >= 0.93 * np.hypot(*force)
    if speed < 0.1:
        assert force @ np.array(possible) > 2.5  # it overcomes friction


def test_a_robot_alone_and_a_lopsided_pair_do_not_push() -> None:
    out = np.empty(2)
    middle = np.array([[0.0, -0.37, 0.0, 1.0]])
    assert not push_forces(body(), (0.0, 1.0), middle, SETUP, out[:1])
    pair = np.array([[0.05, -0.37, 0.0, 1.0], [0.31, -0.37, 0.0, 1.0]])
    assert not push_forces(body(), (0.0, 1.0), pair, SETUP, out)
    pair[0, 0] = -0.31
    assert push_forces(body(), (0.0, 1.0), pair, SETUP, out)
    np.testing.assert_allclose(out, 1.5)
    assert feasible_direction((0.0, -1.0), pair) == (0.0, 0.0)


def test_a_turning_box_is_held_by_the_side_that_leads() -> None:
    pair = np.array([[-0.31, -0.37, 0.0, 1.0], [0.31, -0.37, 0.0, 1.0]])
    pose, out = body(), np.empty(2)
    pose[3], pose[6] = 0.35, 0.2  # it turns to the left: its right side leads
    push_forces(pose, (0.0, 1.0), pair, SETUP, out)
    assert out[0] > out[1]
