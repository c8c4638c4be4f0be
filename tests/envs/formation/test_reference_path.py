"""The reference's path against SciPy's idea of a B-spline, written out, and its three promises."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.formation.reference_path import (
    MIN_EDGE_SHARE,
    PathPlan,
    draw_path,
    spline,
    write_motion,
    write_pose,
)
from swarmdata.types import Double, Float

MATRIX = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
"""Of a uniform cubic B-spline segment (Farin): rows are powers of u, columns control points."""


def plan_of(n_points: int = 12, room: float = 1.6, max_turn: float = 0.8) -> PathPlan:
    n_loop = int(np.ceil(2 * np.pi / max_turn))
    tangent = float(np.tan(max_turn / 2))
    box = np.array([room, 0.8 * room])
    return PathPlan(box, n_points, 0.8, tangent, min(n_points, n_loop), 0.25, 0.6, 0.48)


def drawn(seed: int, plan: PathPlan) -> Float:
    points = np.zeros(2 * plan.n_points, dtype=np.float32)
    state = np.array([seed], dtype=np.uint64)
    for _ in range(50):
        if draw_path(state, plan, points):
            return points
    raise AssertionError("no path in 50 tries")


def twin(points: Float, s: float) -> Double:
    """Position, first and second derivative by s, by the matrix form, [3, 2]."""
    p = points.reshape(-1, 2).astype(np.float64)
    k = min(int(s), len(p) - 4)
    u = s - k
    powers = np.array([[1, u, u * u, u**3], [0, 1, 2 * u, 3 * u * u], [0, 0, 2, 6 * u]])
    return np.asarray(powers @ MATRIX @ p[k : k + 4])


@pytest.mark.slow
@given(seed=st.integers(0, 2**63), s=st.floats(0.0, 9.0))
def test_the_path_is_the_uniform_cubic_b_spline(seed: int, s: float) -> None:
    points = drawn(seed, plan_of())
    row = np.concatenate([np.full(5, 7.0, dtype=np.float32), points])
    expected = twin(points, s)
    np.testing.assert_allclose(spline(row, 5, s), expected.ravel(), atol=1e-9)
    motion, pose = np.zeros(9), np.zeros(4)
    write_motion(row, 5, s, 0.25, motion, 2)
    write_pose(row, 5, s, pose, 0)
    (x, y), d, dd = expected
    speed = np.hypot(*d)
    cross = (d[0] * dd[1] - d[1] * dd[0]) / speed**2
    wanted = [0, 0, x, y, *(0.25 * d), *(d / speed), 0.25 * cross]
    np.testing.assert_allclose(motion, wanted, atol=1e-9)
    np.testing.assert_allclose(pose, [x, y, *(d / speed)], atol=1e-9)


@given(seed=st.integers(0, 2**63), max_turn=st.floats(0.6, 1.2))
def test_paths_keep_their_promises(seed: int, max_turn: float) -> None:
    plan = plan_of(max_turn=max_turn)
    points = drawn(seed, plan)
    p = points.reshape(-1, 2).astype(np.float64)
    assert (np.abs(p) <= plan.room + 1e-6).all()
    edges = np.diff(p, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    assert lengths.max() <= plan.longest + 1e-6
    assert lengths.min() >= MIN_EDGE_SHARE * plan.longest - 1e-6
    turns = (edges[:-1] * edges[1:]).sum(axis=1) / (lengths[:-1] * lengths[1:])
    assert turns.min() >= np.cos(max_turn) - 1e-6
    motions = np.zeros((181, 7))
    for motion, s in zip(motions, np.linspace(0.0, 9.0, 181), strict=True):
        write_motion(points, 0, float(s), plan.rate, motion, 0)
    speeds = np.hypot(motions[:, 2], motions[:, 3])
    assert (np.abs(motions[:, :2]) <= plan.room).all()
    assert speeds.max() <= plan.longest * plan.rate + 1e-6
    assert speeds.min() >= 0.9 * np.cos(max_turn) * MIN_EDGE_SHARE * plan.longest * plan.rate
    assert (speeds + np.abs(motions[:, 6]) * plan.reach).max() <= 1.1 * plan.top
    assert np.abs(np.diff(motions[:, 2:4], axis=0)).max() < 0.02, "the velocity jumps"


def test_most_draws_find_a_path_even_in_a_small_box() -> None:
    plan, points = plan_of(room=1.3), np.zeros(24, dtype=np.float32)
    state = np.array([1], dtype=np.uint64)
    assert sum(draw_path(state, plan, points) for _ in range(200)) > 40


def test_a_box_without_room_gives_no_path() -> None:
    plan, points = plan_of(room=0.3), np.zeros(24, dtype=np.float32)
    state = np.array([1], dtype=np.uint64)
    assert not any(draw_path(state, plan, points) for _ in range(20))
