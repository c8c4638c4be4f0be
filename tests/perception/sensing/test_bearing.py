"""Visible neighbours against a NumPy twin that crosses edges, and hand-made occlusions."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.specs.state_layout import robots_of
from swarmdata.types import Double, Float
from tests.perception.sensing import scenes


def distance_to_segment(point: Double, p: Double, q: Double) -> float:
    """By projecting onto the line and falling back to the ends."""
    d = q - p
    s = (point - p) @ d / (d @ d)
    ends = min(np.linalg.norm(point - p), np.linalg.norm(point - q))
    across = abs(d[0] * (point - p)[1] - d[1] * (point - p)[0]) / np.linalg.norm(d)
    return float(across if 0 <= s <= 1 else ends)


def side(p: Double, q: Double, point: Double) -> float:
    return float((q - p)[0] * (point - p)[1] - (q - p)[1] * (point - p)[0])


def crosses_bar(p: Double, q: Double, bar: Double) -> bool:
    if scenes.encloses(bar, p) or scenes.encloses(bar, q):
        return True
    edges = zip(bar, np.roll(bar, -1, axis=0), strict=True)
    return any(
        side(p, q, a) * side(p, q, b) < 0 and side(a, b, p) * side(a, b, q) < 0 for a, b in edges
    )


def is_hidden(task: Task, robots: Double, rows: Double, i: int, j: int) -> bool:
    p, q = robots[i, :2], robots[j, :2]
    third = [k for k in range(len(robots)) if k not in (i, j)]
    discs = [(robots[k, :2], task.spec.robots[k].radius) for k in third]
    discs += [(row[1:3], row[5]) for row in rows if row[0] == 0]
    if any(distance_to_segment(center, p, q) < radius for center, radius in discs):
        return True
    bars = [bar for row in rows if row[0] > 0 for bar in scenes.bars(row)]
    return any(crosses_bar(p, q, bar) for bar in bars)


def twin(task: Task, state: Float, layout: Float) -> Double:
    """One copy's observations, [N, O]."""
    model: Any = task.spec.observation
    n = task.spec.n_agents
    robots = robots_of(state, n).astype(np.float64)
    rows, out = scenes.rows(task, state, layout), []
    for i, robot in enumerate(task.spec.robots):
        position = robots[:, :2] @ [1, 1j]
        relative = (position - position[i]) / complex(*robots[i, 4:6])
        limit = min(model.range, robot.sensor_range or np.inf)
        order = [int(j) for j in np.argsort(abs(relative)) if j != i and abs(relative[j]) <= limit]
        seen = [j for j in order if not is_hidden(task, robots, rows, i, j)]
        slots = np.zeros((model.n_neighbors, 4))
        for slot, j in zip(slots, seen, strict=False):
            unit = relative[j] / abs(relative[j])
            slot[:] = abs(relative[j]) / model.range, unit.real, unit.imag, 1
        out.append([*scenes.polar(task, robots[i]), *slots.ravel()])
    return np.array(out)


@given(scenes.cases(kind="bearing", n_neighbors=st.integers(0, 5), range=st.floats(0.5, 6.0)))
def test_the_kernel_equals_its_numpy_twin(case: dict[str, Any]) -> None:
    scenes.compare(twin, **case)


ROW = {
    "nothing": None,
    "a circle": [0, 0.5, 0, 1, 0, 0.1, 0.1, 0],
    "a box": [1, 0.5, 0, 0.6, 0.8, 0.1, 0.1, 0],
    "a corner's lower bar": [2, 0.5, 0.22, 1, 0, 0.2, 0.25, 0.03],
    "a pocket seen from its open side": [3, 0.5, 0, 0, 1, 0.2, 0.2, 0.03],
    "a box that touches the line": [1, 0.5, 0.1, 1, 0, 0.1, 0.1, 0],
    "a pocket's lower bar": [3, 0.5, 0.25, 1, 0, 0.3, 0.3, 0.03],
}


@pytest.mark.parametrize("row", ROW)
def test_what_stands_between_two_robots_hides_them(row: str) -> None:
    task = scenes.task({"kind": "bearing", "n_neighbors": 1}, n_agents=2)
    step = scenes.step(task, 1, 0)
    step.states[0] = [0, 0, 0, 0, 1, 0, 1, 1, 1, 0, 0, 0, 1, 0, 1, 1]
    rows = np.array([ROW[row]] if ROW[row] else [], dtype=np.float32).reshape(1, -1, 8)
    out = scenes.observe(task, step._replace(layouts=rows))
    is_visible = row in ("nothing", "a box that touches the line")
    assert (out[0, :, 8] == is_visible).all()
    assert is_visible or not out[0, :, 5:].any()
    if row == "nothing":
        np.testing.assert_allclose(out[0, :, 5:], [[0.5, 1, 0, 1], [0.5, -1, 0, 1]])
