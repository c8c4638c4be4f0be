"""The state observation against its NumPy twin, and what its fields promise."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from swarmdata.interfaces import Task
from swarmdata.numerics.geometry import bounding_radius, nearest
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.perception.sensing.state import order_keys, take_smallest
from swarmdata.specs.state_layout import robots_of
from swarmdata.types import Double, Float, Int
from tests.perception.sensing import scenes


def twin(task: Task, state: Float, layout: Float) -> Double:
    """One copy's observations in plain NumPy, [N, O]."""
    model: Any = task.spec.observation
    robots = task.spec.robots
    rows = robots_of(state, len(robots)).astype(np.float64)
    radius = np.array([robot.radius for robot in robots])
    has_headings = any(robot.dynamics == "unicycle" for robot in robots)
    out = []
    for i, row in enumerate(rows):
        limit = min(model.limit or np.inf, robots[i].sensor_range or np.inf)
        goal = row[6:] - row[:2]
        own = [*row[:4], *goal, *(goal / max(float(np.linalg.norm(goal)), 0.3))]
        own += [*row[4:6]] if has_headings else []
        others: list[tuple[float, list[float]]] = []
        for j in np.delete(np.arange(len(rows)), i):
            d = rows[j, :2] - row[:2]
            gap = np.linalg.norm(d) - radius[i] - radius[j]
            close = np.clip(1 - gap / model.range, 0, 1) * d / np.linalg.norm(d)
            others.append((gap, [*d, *(rows[j, 2:4] - row[2:4]), *close, 1.0]))
        around: list[tuple[float, list[float]]] = []
        for obstacle in layout:
            distance, *v = nearest(*row[:2], obstacle)
            gap = distance - radius[i]
            close = np.clip(1 - gap / model.range, 0, 1) * np.array(v) / max(distance, 1e-9)
            axis = obstacle[3:5].astype(np.float64) * bounding_radius(obstacle)
            center = obstacle[1:3].astype(np.float64) - row[:2]
            around.append((gap, [*close, *center, *axis, obstacle[0] / 3, 1.0]))
        slots = [(others, model.n_neighbors, 7), (around, model.n_obstacles, 8)]
        for found, n_slots, width in slots:
            seen = [pair for pair in found if pair[0] <= limit]
            nearest_first = [features for _, features in sorted(seen, key=lambda pair: pair[0])]
            filled = nearest_first[:n_slots] + [[0.0] * width] * (n_slots - len(seen))
            own += [value for features in filled for value in features]
        out.append(own)
    return np.array(out)


@given(
    scenes.cases(
        5,
        kind="state",
        n_neighbors=st.integers(0, 5),
        n_obstacles=st.integers(0, 8),
        limit=st.none() | st.floats(0.1, 3.0),
    )
)
def test_the_kernel_equals_its_numpy_twin(case: dict[str, Any]) -> None:
    scenes.compare(twin, **case)


def test_the_features_of_the_default_model_keep_their_names_and_order() -> None:
    task = scenes.task({"kind": "state"}, team=[{"count": 4}])
    names = [feature.name for feature in Sensor(task, 1).features]
    own = ["x", "y", "vx", "vy", "goal_dx", "goal_dy", "goal_ux", "goal_uy"]
    near = ["dx", "dy", "dvx", "dvy", "near_x", "near_y", "mask"]
    around = ["near_x", "near_y", "dx", "dy", "axis_x", "axis_y", "kind", "mask"]
    assert names == [
        *(f"own.{name}" for name in own),
        *(f"neighbor_{k}.{name}" for k in range(3) for name in near),
        *(f"obstacle_{k}.{name}" for k in range(3) for name in around),
    ]


def test_every_x_component_is_followed_by_its_y() -> None:
    features = Sensor(scenes.task({"kind": "state"}), 1).features
    for one, two in itertools.pairwise(features):
        assert (one.axis == "x") == (two.axis == "y")
        if one.axis == "x":
            assert (one.kind, one.name.replace("x", "y")) == (two.kind, two.name.replace("x", "y"))


@given(seed=st.integers(0, 2**32), n_slots=st.integers(1, 2), dropout=st.sampled_from([0.0, 0.4]))
def test_more_slots_begin_with_the_bits_of_fewer(seed: int, n_slots: int, dropout: float) -> None:
    blocks = []
    for n_obstacles in (n_slots, 6):  # of 6 obstacles: the likely ones first, and in order
        model = {"kind": "state", "n_obstacles": n_obstacles, "n_neighbors": 0, "dropout": dropout}
        task = scenes.task(model)
        step = scenes.step(task, 3, seed)
        step.layouts[:, [1, 5]] = step.layouts[:, [0, 4]]  # equally near
        blocks.append(scenes.observe(task, step)[..., -8 * n_obstacles :])

    few, many = blocks
    assert few.tobytes() == many[..., : 8 * n_slots].tobytes()


numbers = st.floats(allow_nan=False).map(lambda x: x + 0.0)  # -0 becomes 0


@njit  # type: ignore[untyped-decorator]
def ranks(values: Double) -> Int:
    """Indices of the values, smallest first, by the functions under test."""
    keys = values.copy().view(np.int64)
    order_keys(keys)
    out = np.empty(values.shape[0], np.int64)
    for k in range(values.shape[0]):
        out[k] = take_smallest(keys)
    return out


@pytest.mark.slow
@given(
    st.lists(numbers, max_size=70)
    | st.lists(st.sampled_from([-np.inf, -1.5, 0.0, 5e-324, 2.0, np.inf]), max_size=40)
)
def test_taking_the_smallest_numbers_in_turn_is_a_stable_sort(values: list[float]) -> None:
    array = np.array(values, dtype=np.float64)
    np.testing.assert_array_equal(ranks(array), np.argsort(array, kind="stable"))
