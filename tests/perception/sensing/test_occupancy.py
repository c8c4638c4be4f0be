"""The grid against a NumPy twin that asks of every cell how far everything is."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.specs.state_layout import robots_of
from swarmdata.types import Double, Float
from tests.perception.sensing import scenes


def distance_to_bar(points: Double, bar: Double) -> Double:
    """Distances from points [C, 2] to a rectangle, 0 inside, [C]."""
    axes, center = np.array([bar[1] - bar[0], bar[3] - bar[0]]) / 2, bar.mean(axis=0)
    sizes = np.linalg.norm(axes, axis=1)
    local = abs((points - center) @ (axes / sizes[:, None]).T)
    return np.asarray(np.linalg.norm(np.maximum(local - sizes, 0), axis=1))


def distance_to(points: Double, row: Double) -> Double:
    if row[0] == 0:
        return np.asarray(np.linalg.norm(points - row[1:3], axis=1) - row[5])
    return np.min([distance_to_bar(points, bar) for bar in scenes.bars(row)], axis=0)


def twin(task: Task, state: Float, layout: Float) -> Double:
    """One copy's observations, [N, O]."""
    model: Any = task.spec.observation
    n = task.spec.n_agents
    robots, half_cell = robots_of(state, n).astype(np.float64), model.cell_size / 2
    rows, out = scenes.rows(task, state, layout), []
    steps = (np.arange(model.cells) - (model.cells - 1) / 2) * model.cell_size
    for i, robot in enumerate(task.spec.robots):
        local = (steps[:, None] + 1j * steps).ravel()
        world = complex(*robots[i, :2]) + complex(*robots[i, 4:6]) * local
        points = np.stack([world.real, world.imag], axis=1)
        grid = np.zeros((len(points), 3 if len(rows) > len(layout) else 2), dtype=np.bool_)
        for j in np.delete(np.arange(n), i):
            away = np.linalg.norm(points - robots[j, :2], axis=1)
            grid[:, 0] |= away <= task.spec.robots[j].radius + half_cell
        for m, row in enumerate(rows):
            grid[:, 1 + (m >= len(layout))] |= distance_to(points, row) <= half_cell
        half = np.array([task.spec.arena.width, task.spec.arena.height]) / 2
        grid[:, 1] |= (abs(points) > half).any(axis=1)
        grid[abs(local) > (robot.sensor_range or np.inf)] = False
        out.append([*scenes.polar(task, robots[i]), *grid.ravel()])
    return np.array(out)


@given(scenes.cases(kind="occupancy", cells=st.integers(1, 12), cell_size=st.floats(0.05, 0.6)))
def test_the_kernel_equals_its_numpy_twin(case: dict[str, Any]) -> None:
    scenes.compare(twin, **case)
