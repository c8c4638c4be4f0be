"""Waypoints among known obstacles: a distance field on a grid, and the farthest visible point.

The map of an episode is a grid of clearances, and for every robot the next node on the cheapest
way to its goal from every node (Dijkstra, "A note on two problems in connexion with graphs", 1959,
with the bucket queue of Dial, "Algorithm 360", CACM 1969, since costs are small integers). Nodes
near surfaces cost more, so that ways keep to the middle of passages. A robot aims at the farthest
point of its way that it can reach in a straight line.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swarmdata.geometry import BOX, CIRCLE, CORNER, POCKET, clearance
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, Float

Int32 = NDArray[np.int32]

SPACING = 0.05
"""Metres between nodes. A passage of 0.34 m leaves a strip 0.1 m wide for the centre of a robot of
radius 0.12 m; a strip as wide as the spacing holds an 8-connected chain of nodes."""

MARGIN = 0.015
"""Metres of free gap that a straight line must leave to be taken."""

LOOKAHEAD = 40
"""Nodes of the way that are searched for a visible one: 2 to 2.8 m."""

STRAIGHT, DIAGONAL = 5, 7
"""Costs of a step to the next node; 7 / 5 is within 1 % of sqrt(2)."""

WEIGHTS = (1, 2, 6, 40)
"""Factors on the cost of entering a node whose free gap is above 0.10, 0.04 and `MARGIN` metres, or
below that. The last is for robots that were pushed against a surface: they find a way out."""

N_BUCKETS = DIAGONAL * WEIGHTS[3] + 1

N_PRIMITIVES = {CIRCLE: 1, BOX: 1, CORNER: 2, POCKET: 3}


def grid_shape(spec: TaskSpec) -> tuple[int, int]:
    """Returns the number of nodes along y and x."""
    arena = spec.arena
    return int(arena.height / SPACING) + 1, int(arena.width / SPACING) + 1


@njit(nogil=True, cache=True)
def fill_clearances(layout: Float, half: Double, out: Float) -> None:
    """Writes the distance from every node to the nearest surface or wall.

    Args:
        layout: obstacles, [M, 8].
        half: half width and half height of the arena, m, [2].
        out: written, m, [rows, columns]; node (0, 0) is the lower left corner of the arena.
    """
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            x, y = column * SPACING - half[0], row * SPACING - half[1]
            out[row, column] = clearance(x, y, layout, half)


@njit(nogil=True, cache=True)
def free_distance(x: float, y: float, grid: Float, half: Double) -> float:
    """Returns the clearance at a point, interpolated bilinearly; points outside are moved in.

    Args:
        x: point, m.
        y: point, m.
        grid: clearances of the nodes, m, [rows, columns].
        half: half width and half height of the arena, m, [2].
    """
    u = min(max((x + half[0]) / SPACING, 0.0), grid.shape[1] - 1.001)
    v = min(max((y + half[1]) / SPACING, 0.0), grid.shape[0] - 1.001)
    column, row = int(u), int(v)
    u, v = u - column, v - row
    below = (1.0 - u) * grid[row, column] + u * grid[row, column + 1]
    above = (1.0 - u) * grid[row + 1, column] + u * grid[row + 1, column + 1]
    return (1.0 - v) * below + v * above


@njit(nogil=True, cache=True)
def is_visible(
    x: float, y: float, to_x: float, to_y: float, need: float, grid: Float, half: Double
) -> bool:
    """Returns whether the straight line between two points keeps `need` metres of clearance.

    Where the start or the end has less, the line may have as little. The line is walked in steps as
    long as what is free beyond the need (sphere tracing: Hart, 1996), at least half a spacing.
    """
    dx, dy = to_x - x, to_y - y
    length = math.sqrt(dx * dx + dy * dy)
    need = min(need, free_distance(x, y, grid, half) - 1e-3)
    need = min(need, free_distance(to_x, to_y, grid, half) - 1e-3)
    walked = 0.0
    while walked < length:
        share = walked / length
        free = free_distance(x + share * dx, y + share * dy, grid, half) - need
        if free < 0.0:
            return False
        walked += max(free, 0.5 * SPACING)
    return True


@njit(nogil=True, cache=True)
def fill_weights(grid: Float, radius: float, out: Int32) -> None:
    """Writes the cost factor of entering each node for a robot of `radius`; 0 means never.

    Args:
        grid: clearances, m, [rows, columns].
        radius: m.
        out: written, [rows * columns].
    """
    flat = grid.ravel()
    for node in range(flat.shape[0]):
        gap = flat[node] - radius
        if flat[node] <= 0.5 * radius:
            out[node] = 0
        elif gap < MARGIN:
            out[node] = WEIGHTS[3]
        elif gap < 0.04:
            out[node] = WEIGHTS[2]
        else:
            out[node] = WEIGHTS[1] if gap < 0.10 else WEIGHTS[0]


@njit(nogil=True, cache=True, inline="always")
def _unlink(node: int, bucket: int, heads: Int32, links: Int32) -> None:
    before, after = links[node, 0], links[node, 1]
    if before >= 0:
        links[before, 1] = after
    else:
        heads[bucket] = after
    if after >= 0:
        links[after, 0] = before


@njit(nogil=True, cache=True, inline="always")
def _push(node: int, bucket: int, heads: Int32, links: Int32) -> None:
    first = heads[bucket]
    links[node, 0], links[node, 1] = -1, first
    if first >= 0:
        links[first, 0] = node
    heads[bucket] = node


@njit(nogil=True, cache=True)
def fill_ways(goal: int, columns: int, weights: Int32, costs: Int32, ways: Int32) -> None:
    """Writes for every node the cost of the cheapest way to the goal and the next node on it.

    Args:
        goal: node, row * columns + column.
        columns: nodes in a row.
        weights: cost factor of entering each node, 0 where it cannot be, [n].
        costs: written, [n]; -1 where there is no way.
        ways: written, [n]; the goal's next node is itself.
    """
    rows = weights.shape[0] // columns
    heads = np.full(N_BUCKETS, -1, dtype=np.int32)
    links = np.empty((weights.shape[0], 2), dtype=np.int32)
    settled = np.zeros(weights.shape[0], dtype=np.bool_)
    costs[:], ways[:] = -1, -1
    costs[goal], ways[goal] = 0, goal
    _push(goal, 0, heads, links)
    cost, waiting = 0, 1
    while waiting > 0:
        bucket = cost % N_BUCKETS
        node = heads[bucket]
        if node < 0:
            cost += 1
            continue
        _unlink(node, bucket, heads, links)
        settled[node], waiting = True, waiting - 1
        row, column = node // columns, node % columns
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                near = r * columns + c
                if settled[near] or weights[near] == 0:
                    continue
                base = STRAIGHT if r == row or c == column else DIAGONAL
                new = cost + base * weights[near]
                if costs[near] >= 0:
                    if costs[near] <= new:
                        continue
                    _unlink(near, costs[near] % N_BUCKETS, heads, links)
                    waiting -= 1
                costs[near], ways[near] = new, node
                _push(near, new % N_BUCKETS, heads, links)
                waiting += 1


@njit(nogil=True, cache=True)
def nearest_node(x: float, y: float, costs: Int32, columns: int, half: Double) -> int:
    """Returns the node with a way to the goal that is nearest to a point, or -1.

    Args:
        x: point, m.
        y: point, m.
        costs: of the ways, -1 where there is none, [n].
        columns: nodes in a row.
        half: half width and half height of the arena, m, [2].
    """
    u, v = (x + half[0]) / SPACING, (y + half[1]) / SPACING
    rows = costs.shape[0] // columns
    column = min(max(int(u + 0.5), 0), columns - 1)
    row = min(max(int(v + 0.5), 0), rows - 1)
    if costs[row * columns + column] >= 0:
        return row * columns + column
    best, found = 1e9, -1
    for r in range(max(row - 2, 0), min(row + 3, rows)):
        for c in range(max(column - 2, 0), min(column + 3, columns)):
            square = (c - u) * (c - u) + (r - v) * (r - v)
            if costs[r * columns + c] >= 0 and square < best:
                best, found = square, r * columns + c
    return found


@njit(nogil=True, cache=True)
def waypoint(
    x: float, y: float, goal: Double, need: float, grid: Float, ways: tuple[Int32, Int32], half: Double
) -> tuple[float, float]:
    """Returns the point to aim at: the goal if visible, else the farthest visible node of the way.

    Args:
        x: position, m.
        y: position, m.
        goal: m, [2].
        need: clearance that the straight line must keep, m.
        grid: clearances, m, [rows, columns].
        ways: costs and next nodes, each [n].
        half: half width and half height of the arena, m, [2].
    """
    if is_visible(x, y, goal[0], goal[1], need, grid, half):
        return goal[0], goal[1]
    costs, following = ways
    columns = grid.shape[1]
    node = nearest_node(x, y, costs, columns, half)
    if node < 0:
        return goal[0], goal[1]
    best = following[node]
    for hop in range(LOOKAHEAD):
        node = following[node]
        if hop % 2 == 1:
            to_x = (node % columns) * SPACING - half[0]
            to_y = (node // columns) * SPACING - half[1]
            if not is_visible(x, y, to_x, to_y, need, grid, half):
                break
            best = node
    return (best % columns) * SPACING - half[0], (best // columns) * SPACING - half[1]


def primitives_of(layout: Float) -> Float:
    """Returns the same obstacles as convex shapes: a corner is 2 boxes, a pocket 3.

    Args:
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].

    Returns:
        Circles and boxes, the same columns, [P, 8].
    """
    shapes = [_bar(row, k) for row in layout for k in range(N_PRIMITIVES[float(row[0])])]
    return np.array(shapes, dtype=np.float32).reshape(-1, 8)


def _bar(row: Float, k: int) -> Float:
    """Convex part k of an obstacle: the bar along -y, then along -x, then along +x."""
    kind, x, y, ux, uy, a, b, t = (float(value) for value in row)
    if kind in (CIRCLE, BOX):
        return row
    cx, cy, hx, hy = ((0.0, t - b, a, t), (t - a, 0.0, t, b), (a - t, 0.0, t, b))[k]
    centre = (x + cx * ux - cy * uy, y + cx * uy + cy * ux)
    return np.array([BOX, *centre, ux, uy, hx, hy, 0.0], dtype=np.float32)


def n_primitives(spec: TaskSpec) -> int:
    """Number of convex shapes in a layout of this spec, P."""
    o = spec.obstacles
    counts = ((o.circles, CIRCLE), (o.boxes, BOX), (o.corners, CORNER), (o.pockets, POCKET))
    return sum(count * N_PRIMITIVES[kind] for count, kind in counts)
