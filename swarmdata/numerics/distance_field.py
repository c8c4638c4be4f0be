"""The map of an episode: clearances on a grid, and the cheapest path to a goal from every node.

Dijkstra's algorithm (Numerische Mathematik 1, 1959, problem 2) with the bucket queue of Dial
("Algorithm 360: shortest-path forest with topological ordering", CACM 1969). Arithmetic as in
`geometry`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.numerics.geometry import bounding_radius, nearest
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import Arena
from swarmdata.types import Double, Float

Int32 = NDArray[np.int32]

PATH_GAP = 0.015  # metres of free gap that a path keeps where it can
CLEARANCE_MARGIN = 0.15  # metres beyond the largest radius up to which clearances are computed

STRAIGHT_COST, DIAGONAL_COST = 5, 7
"""Costs of a step to the next node; 7 / 5 is within 1 % of sqrt(2)."""

GAP_LEVELS = (0.10, 0.04, PATH_GAP)
GAP_WEIGHTS = (1, 2, 6, 40)
"""Gaps, m, and the factors on the cost of entering a node whose free gap is above each of them, and
below all, where robots are that were pushed against a surface."""

N_BUCKETS = 512
"""A power of two above the largest cost of a step: a bucket's number is the last bits of a cost."""

LAST_BITS = N_BUCKETS - 1


class Ground(NamedTuple):
    """The free space of one episode, on a grid; node (0, 0) is the lower left corner."""

    clearances: Float  # [rows, columns] m, from each node to the nearest surface or wall
    half: Double  # [2] m, half width and half height of the arena
    spacing: float  # m, between nodes


def grid_shape(arena: Arena, spacing: float) -> tuple[int, int]:
    """Returns the number of nodes along y and along x, `spacing` metres apart."""
    return int(arena.height / spacing) + 1, int(arena.width / spacing) + 1


@kernel
def fill_clearances(layout: Float, cap: float, ground: Ground) -> None:
    """Writes each node's distance to walls and obstacles of a layout [M, 8], at most `cap`, m."""
    out, half, spacing = ground
    rows, columns = out.shape
    for row in range(rows):
        for column in range(columns):
            x, y = column * spacing - half[0], row * spacing - half[1]
            out[row, column] = min(cap, half[0] - abs(x), half[1] - abs(y))
    for m in range(layout.shape[0]):
        reach = bounding_radius(layout[m]) + cap
        u, v = float(layout[m, 1]) + half[0], float(layout[m, 2]) + half[1]
        first, last = max(int((u - reach) / spacing), 0), int((u + reach) / spacing)
        low, high = max(int((v - reach) / spacing), 0), int((v + reach) / spacing)
        for row in range(low, min(high + 2, rows)):
            for column in range(first, min(last + 2, columns)):
                x, y = column * spacing - half[0], row * spacing - half[1]
                dx, dy = u - half[0] - x, v - half[1] - y
                if dx * dx + dy * dy < reach * reach:
                    out[row, column] = min(out[row, column], nearest(x, y, layout[m])[0])


@kernel
def weights_of(grid: Float, radius: float) -> Int32:
    """Returns the cost factor of entering each node, 0 where no robot fits, [rows * columns].

    The border is always 0, so every node that can be entered has eight neighbors. The grid holds
    clearances, m, [rows, columns].
    """
    rows, columns = grid.shape
    weights = np.zeros(rows * columns, dtype=np.int32)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            gap = grid[row, column] - radius
            if gap <= -0.5 * radius:
                continue
            weight = GAP_WEIGHTS[0]
            for level in range(3):
                if gap < GAP_LEVELS[level]:
                    weight = GAP_WEIGHTS[level + 1]
            weights[row * columns + column] = weight
    return weights


@kernel
def fill_paths(goal: int, columns: int, weights: Int32, costs: Int32, next_nodes: Int32) -> None:
    """Writes for every node the cost of the cheapest path to the goal and the next node on it.

    Args:
        goal: node, row * columns + column; it can be entered.
        columns: nodes in a row.
        weights: cost factor of entering each node, 0 where it cannot be and on the border, [n].
        costs: written, [n]; -1 where there is no path.
        next_nodes: written, [n]; the goal's next node is itself.
    """
    heads = np.full(N_BUCKETS, -1, dtype=np.int32)  # first node of each bucket
    before, after = np.empty_like(weights), np.empty_like(weights)  # in the bucket, -1 at its ends
    costs[:], next_nodes[:] = -1, -1
    costs[goal], next_nodes[goal] = 0, goal
    heads[0], before[goal], after[goal] = goal, -1, -1
    cost, waiting = 0, 1
    while waiting > 0:
        node = heads[cost & LAST_BITS]
        if node < 0:
            cost += 1
            continue
        second = after[node]
        heads[cost & LAST_BITS] = second
        if second >= 0:
            before[second] = -1
        waiting -= 1
        for up in range(-1, 2):
            for right in range(-1, 2):
                near = np.uintp(node + up * columns + right)  # never counts from the end
                if weights[near] == 0:
                    continue
                step = DIAGONAL_COST if up != 0 and right != 0 else STRAIGHT_COST
                old, new = costs[near], cost + step * weights[near]
                if 0 <= old <= new:  # settled nodes end here: they were cheaper
                    continue
                waiting += 1 if old < 0 else 0
                _move(near, old, new, heads, before, after)
                costs[near], next_nodes[near] = new, node


@kernel(inline="always")
def _move(node: int, old: int, new: int, heads: Int32, before: Int32, after: Int32) -> None:
    """Moves a node from the bucket of its old cost, if it has one, to the start of another."""
    if old >= 0:
        left, rest = before[node], after[node]
        if left >= 0:
            after[left] = rest
        else:
            heads[old & LAST_BITS] = rest
        if rest >= 0:
            before[rest] = left
    first = heads[new & LAST_BITS]
    if first >= 0:
        before[first] = node
    before[node], after[node], heads[new & LAST_BITS] = -1, first, node


@kernel
def nearest_node(x: float, y: float, costs: Int32, ground: Ground) -> int:
    """Returns the node with a path that is nearest to a point, m, or -1.

    Costs of paths are [n], -1 where there is none.
    """
    (rows, columns), half, spacing = ground.clearances.shape, ground.half, ground.spacing
    u, v = (x + half[0]) / spacing, (y + half[1]) / spacing
    column = min(max(int(u + 0.5), 0), columns - 1)
    row = min(max(int(v + 0.5), 0), rows - 1)
    if costs[row * columns + column] >= 0:
        return int(row * columns + column)
    best, found = 1e9, -1
    for r in range(max(row - 2, 0), min(row + 3, rows)):
        for c in range(max(column - 2, 0), min(column + 3, columns)):
            square = (c - u) * (c - u) + (r - v) * (r - v)
            if costs[r * columns + c] >= 0 and square < best:
                best, found = square, r * columns + c
    return found
