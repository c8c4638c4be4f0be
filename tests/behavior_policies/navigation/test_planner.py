"""The distance field against a plain Dijkstra, and waypoints around a pocket."""

import heapq

import numpy as np
import pytest

from swarmdata.behavior_policies.navigation.distance_field import (
    DIAGONAL_COST,
    NODE_SPACING,
    STRAIGHT_COST,
    Int32,
    fill_clearances,
    fill_paths,
    grid_shape,
    nearest_node,
    weights_of,
)
from swarmdata.behavior_policies.navigation.planner import (
    UNPLANNED_COST,
    Ground,
    Paths,
    free_distance,
    is_visible,
    n_primitives,
    primitives_of,
    waypoint,
)
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, clearance, nearest
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env, make_task
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float

SPEC = TaskSpec()
HALF = np.array([2.0, 2.0])
POCKET_ROW = np.array([[POCKET, 0.0, 0.0, 0.0, 1.0, 0.4, 0.4, 0.05]], dtype=np.float32)
"""A pocket that opens towards -x."""


def grid_of(layout: Float, cap: float = 0.27) -> Float:
    grid = np.zeros(grid_shape(SPEC), dtype=np.float32)
    fill_clearances(layout, HALF, cap, grid)
    return grid


def unplanned(n_nodes: int) -> Paths:
    return Paths(np.full(n_nodes, UNPLANNED_COST, np.int32), np.zeros(n_nodes, np.int32))


def layout_of(seed: int) -> Float:
    layout: Float = make_env(SPEC, 1).reset(evaluation_seeds(seed + 1)[-1:]).layouts[0]
    return layout


@pytest.mark.parametrize("seed", [0, 1])
def test_clearances_are_those_of_the_geometry_up_to_the_cap(seed: int) -> None:
    layout = layout_of(seed)
    grid = grid_of(layout)
    rng = np.random.default_rng(seed)
    for row, column in rng.integers(0, 81, size=(400, 2)):
        x, y = column * NODE_SPACING - 2.0, row * NODE_SPACING - 2.0
        assert grid[row, column] == pytest.approx(
            min(clearance(x, y, layout, HALF), 0.27), abs=1e-6
        )


def test_interpolated_clearance_is_close() -> None:
    layout = layout_of(0)
    ground = Ground(grid_of(layout), HALF)
    for x, y in np.random.default_rng(0).uniform(-1.99, 1.99, size=(400, 2)):
        expected = min(clearance(x, y, layout, HALF), 0.27)
        assert free_distance(x, y, ground) == pytest.approx(expected, abs=0.02)


def plain_costs(goal: int, columns: int, weights: Int32) -> Double:
    costs = np.full(len(weights), np.inf)
    costs[goal], queue = 0, [(0, goal)]
    while queue:
        cost, node = heapq.heappop(queue)
        if cost > costs[node]:
            continue
        for row in (-1, 0, 1):
            for column in (-1, 0, 1):
                near = node + row * columns + column
                base = DIAGONAL_COST if row and column else STRAIGHT_COST
                new = cost + base * int(weights[near])
                if weights[near] and new < costs[near]:
                    costs[near] = new
                    heapq.heappush(queue, (new, near))
    return np.where(np.isinf(costs), -1, costs)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_paths_are_the_cheapest(seed: int) -> None:
    grid = grid_of(layout_of(seed))
    weights = weights_of(grid, 0.12)
    columns = grid.shape[1]
    goal = nearest_node(0.3 * seed - 0.5, 0.4, weights - 1, columns, HALF)
    costs, next_nodes = np.zeros((2, len(weights)), np.int32)
    fill_paths(goal, columns, weights, costs, next_nodes)
    np.testing.assert_array_equal(costs, plain_costs(goal, columns, weights))
    reachable = np.flatnonzero(costs > 0)
    assert len(reachable) > 3000
    assert (costs[next_nodes[reachable]] < costs[reachable]).all()


def test_a_wall_hides_and_an_opening_does_not() -> None:
    ground = Ground(grid_of(POCKET_ROW), HALF)
    assert not is_visible((-1.0, 0.0), (1.0, 0.0), 0.135, ground)
    assert is_visible((-1.0, 0.0), (0.0, 0.0), 0.135, ground)
    assert is_visible((-1.0, 1.0), (1.0, 1.0), 0.135, ground)


def test_waypoints_lead_out_of_a_pocket_without_touching_it() -> None:
    ground = Ground(grid_of(POCKET_ROW), HALF)
    paths = unplanned(ground.clearances.size)
    x, y, goal = 0.1, 0.0, np.array([1.2, 0.0])
    first = waypoint((x, y), goal, 0.12, ground, paths)
    assert first[0] < -0.3  # out of the mouth first
    for _ in range(200):
        to_x, to_y = waypoint((x, y), goal, 0.12, ground, paths)
        d = float(np.hypot(to_x - x, to_y - y))
        step = min(0.05, d) / max(d, 1e-9)
        x, y = x + step * (to_x - x), y + step * (to_y - y)
        assert clearance(x, y, POCKET_ROW, HALF) > 0.12
    assert (x, y) == pytest.approx((1.2, 0.0), abs=1e-6)


def test_without_a_path_the_goal_is_aimed_at() -> None:
    grid = np.zeros(grid_shape(SPEC), dtype=np.float32)
    grid[40, 20] = 0.3
    ground, goal = Ground(grid, HALF), np.array([1.0, 1.0])
    assert waypoint((-1.0, 0.0), goal, 0.12, ground, unplanned(grid.size)) == (1.0, 1.0)


@pytest.mark.parametrize("kind", [CIRCLE, BOX, CORNER, POCKET])
def test_primitives_are_the_same_obstacle(kind: float) -> None:
    row = np.array([kind, 0.3, -0.2, 0.6, 0.8, 0.35, 0.3, 0.05], dtype=np.float32)
    parts = primitives_of(row[None])
    for x, y in np.random.default_rng(0).uniform(-1.5, 1.5, size=(300, 2)):
        distance = min(nearest(x, y, part)[0] for part in parts)
        assert distance == pytest.approx(nearest(x, y, row)[0], abs=1e-6)


def test_the_spec_tells_the_number_of_primitives() -> None:
    assert (
        len(primitives_of(layout_of(0))) == n_primitives(make_task(SPEC).kinds) == 2 + 1 + 2 + 2 * 3
    )
    empty = np.zeros((0, 8), dtype=np.float32)
    assert primitives_of(empty).shape == (0, 8)
