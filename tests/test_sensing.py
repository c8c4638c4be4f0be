"""The state observation against its NumPy twin, and what its fields promise."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav import CoopNav
from swarmdata.geometry import bounding_radius, nearest
from swarmdata.sensing import state_observation_fields, state_observation_size
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, Float


def twin(spec: TaskSpec, state: Float, layout: Float) -> Double:
    """One copy's observations in plain NumPy, [N, O]."""
    model = spec.observation
    rows = state.reshape(-1, 6).astype(np.float64)
    radius = np.array([robot.radius for robot in spec.robots])
    out = []
    for i, row in enumerate(rows):
        goal = row[4:] - row[:2]
        own = [*row[:4], *goal, *(goal / max(float(np.linalg.norm(goal)), 0.3))]
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
            nearest_first = [features for _, features in sorted(found, key=lambda pair: pair[0])]
            filled = nearest_first[:n_slots] + [[0.0] * width] * (n_slots - len(found))
            own += [value for features in filled for value in features]
        out.append(own)
    return np.array(out)


@given(
    seed=st.integers(0, 2**32),
    n_neighbors=st.integers(0, 5),
    n_obstacles=st.integers(0, 8),
    n_agents=st.integers(1, 5),
)
def test_the_kernel_equals_its_numpy_twin(
    seed: int, n_neighbors: int, n_obstacles: int, n_agents: int
) -> None:
    slots = {"n_neighbors": n_neighbors, "n_obstacles": n_obstacles}
    spec = TaskSpec.parse({"observation": slots, "team": [{"count": n_agents}]})
    step = CoopNav(spec, 2).reset(np.array([seed, seed + 1], dtype=np.uint64))
    for copy in range(2):
        expected = twin(spec, step.states[copy], step.layouts[copy])
        np.testing.assert_allclose(step.observations[copy], expected, atol=2e-6)


def test_field_names_match_the_observation() -> None:
    fields = state_observation_fields(3, 3)
    assert len(fields) == state_observation_size(3, 3) == CoopNav(TaskSpec()).observation_size
    assert len(set(fields)) == len(fields)


def test_empty_slots_are_zero_with_mask_zero() -> None:
    spec = TaskSpec.parse({"team": [{"count": 2}]})
    step = CoopNav(spec).reset(np.array([1], dtype=np.uint64))
    fields = state_observation_fields(3, 3)
    empty = [k for k, name in enumerate(fields) if name.startswith(("neighbor_1", "neighbor_2"))]
    assert not step.observations[..., empty].any()
    assert (step.observations[..., fields.index("neighbor_0.mask")] == 1).all()
