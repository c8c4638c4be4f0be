"""The distance field against the geometry and a plain Dijkstra."""

import heapq

import numpy as np
import pytest

from swarmdata.numerics.distance_field import (
    DIAGONAL_COST,
    STRAIGHT_COST,
    Int32,
    fill_paths,
    nearest_node,
    weights_of,
)
from swarmdata.numerics.geometry import clearance
from swarmdata.types import Double
from tests.support.grounds import HALF, SPACING, ground_of, layout_of


@pytest.mark.parametrize("seed", [0, 1])
def test_clearances_are_those_of_the_geometry_up_to_the_cap(seed: int) -> None:
    layout = layout_of(seed)
    grid = ground_of(layout).clearances
    rng = np.random.default_rng(seed)
    for row, column in rng.integers(0, 81, size=(400, 2)):
        x, y = column * SPACING - 2.0, row * SPACING - 2.0
        assert grid[row, column] == pytest.approx(
            min(clearance(x, y, layout, HALF), 0.27), abs=1e-6
        )


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
    ground = ground_of(layout_of(seed))
    weights = weights_of(ground.clearances, 0.12)
    columns = ground.clearances.shape[1]
    goal = nearest_node(0.3 * seed - 0.5, 0.4, weights - 1, ground)
    costs, next_nodes = np.zeros((2, len(weights)), np.int32)
    fill_paths(goal, columns, weights, costs, next_nodes)
    np.testing.assert_array_equal(costs, plain_costs(goal, columns, weights))
    reachable = np.flatnonzero(costs > 0)
    assert len(reachable) > 3000
    assert (costs[next_nodes[reachable]] < costs[reachable]).all()
