"""Whose slot is whose, against every permutation, and how slots move."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.envs.formation.shapes import slot_offsets
from swarmdata.envs.formation.slots import (
    HELD,
    PREVIEW,
    Course,
    Scratch,
    place_slots,
    slot_velocity,
)
from swarmdata.numerics.assignment import assignment_work
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, X, Y, robots_of
from swarmdata.types import Double, Float


def course_of(n: int, is_assigned: bool) -> Course:
    offsets = slot_offsets(FormationRules(), n)
    return offsets, is_assigned, 0.025, 0.25, np.zeros(0)


def scratch_of(n: int) -> Scratch:
    return (np.zeros((n, 2)), np.zeros((n, n)), *assignment_work(n))


def state_of(seed: int, n: int) -> Float:
    """Robots anywhere, and a reference with a random pose and motion, [S]."""
    rng = np.random.default_rng(seed)
    state = rng.uniform(-2, 2, N_COLUMNS * n + PREVIEW).astype(np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    state[N_COLUMNS * n + 4 : N_COLUMNS * n + 6] = np.cos(angle), np.sin(angle)
    return state


def slots_of(state: Float, n: int) -> Double:
    x, y, _, _, ux, uy, _ = state[N_COLUMNS * n : N_COLUMNS * n + HELD].astype(np.float64)
    turn = np.array([[ux, -uy], [uy, ux]])
    return np.array([x, y]) + slot_offsets(FormationRules(), n) @ turn.T


def team_cost(places: Double, slots: Double) -> float:
    return float(((places - slots) ** 2).sum())


@given(seed=st.integers(0, 2**32), n=st.integers(1, 6))
def test_assigned_slots_have_the_least_sum_of_squared_distances(seed: int, n: int) -> None:
    state = state_of(seed, n)
    place_slots(state, course_of(n, True), scratch_of(n))
    robots, slots = robots_of(state, n).astype(np.float64), slots_of(state, n)
    targets, places = robots[:, [TX, TY]], robots[:, [X, Y]]
    least = min(team_cost(places, slots[list(order)]) for order in permutations(range(n)))
    np.testing.assert_allclose(team_cost(places, targets), least, rtol=1e-5, atol=1e-6)
    order = [int(np.argmin(np.linalg.norm(slots - target, axis=1))) for target in targets]
    assert sorted(order) == list(range(n)), "a slot is missing"
    np.testing.assert_allclose(targets, slots[order], atol=1e-6)


@given(seed=st.integers(0, 2**32), n=st.integers(1, 9))
def test_fixed_slots_belong_to_their_robots(seed: int, n: int) -> None:
    state = state_of(seed, n)
    place_slots(state, course_of(n, False), scratch_of(n))
    np.testing.assert_allclose(robots_of(state, n)[:, [TX, TY]], slots_of(state, n), atol=1e-5)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32), n=st.integers(1, 5))
def test_slot_velocities_are_those_of_a_rigid_body(seed: int, n: int) -> None:
    state, h = state_of(seed, n).astype(np.float64), 1e-6
    place_slots(state, course_of(n, False), scratch_of(n))
    later, at = state.copy(), N_COLUMNS * n
    later[at : at + 2] += h * state[at + 2 : at + 4]
    turn = h * state[at + 6]
    cos, sin = np.cos(turn), np.sin(turn)
    later[at + 4 : at + 6] = np.array([[cos, -sin], [sin, cos]]) @ state[at + 4 : at + 6]
    place_slots(later, course_of(n, False), scratch_of(n))
    for i in range(n):
        moved = later[N_COLUMNS * i + TX :][:2] - state[N_COLUMNS * i + TX :][:2]
        np.testing.assert_allclose(slot_velocity(state, n, i), moved / h, atol=1e-4)
