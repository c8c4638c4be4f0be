"""The assignment problem (least total cost), in compiled code.

Source: Kuhn, "The Hungarian method for the assignment problem", Naval Research Logistics Quarterly
2, 1955, as successive shortest paths with potentials: Jonker and Volgenant, "A shortest augmenting
path algorithm for dense and sparse linear assignment problems", Computing 38, 1987. It uses only
`+ -` and comparisons in float64: its bits are the same everywhere.
"""

import math

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Int

_SHIFT, _LIFT, _PATH, _IS_SETTLED = range(4)
_COLUMN, _OWNER, _BEFORE = range(3)


def assignment_work(n: int) -> tuple[Double, Int]:
    """Returns scratch memory for `assign` with n rows."""
    return np.zeros((4, n + 1)), np.zeros((3, n + 1), dtype=np.int64)


@kernel
def assign(costs: Double, work: Double, places: Int) -> float:
    """Returns the least cost of an assignment, of finite costs [n, n]; ties are deterministic.

    `assignment_work` gives the other arrays; row 0 of `places` then holds the column of each row.
    """
    n = costs.shape[0]
    work[_SHIFT], work[_LIFT] = 0.0, 0.0
    places[_OWNER] = -1
    for i in range(n):
        places[_OWNER, n] = i  # the search starts at column n, which does not exist
        free = _shortest_path(costs, work, places)
        while free != n:
            before = places[_BEFORE, free]
            places[_OWNER, free] = places[_OWNER, before]
            free = before
    total = 0.0
    for j in range(n):
        places[_COLUMN, places[_OWNER, j]] = j
    for i in range(n):
        total += costs[i, places[_COLUMN, i]]
    return total


@kernel
def _shortest_path(costs: Double, work: Double, places: Int) -> int:
    """Returns the column without a row at the end of the shortest path from column n."""
    n = costs.shape[0]
    shift, lift, path, is_settled = work[_SHIFT], work[_LIFT], work[_PATH], work[_IS_SETTLED]
    owner, before = places[_OWNER], places[_BEFORE]
    path[:], is_settled[:] = math.inf, 0.0
    now = n
    while owner[now] >= 0:
        is_settled[now] = 1.0
        row, following, least = owner[now], -1, math.inf
        for j in range(n):
            if is_settled[j] == 1.0:
                continue
            reduced = costs[row, j] - lift[row] - shift[j]
            if reduced < path[j]:
                path[j], before[j] = reduced, now
            if path[j] < least:
                least, following = path[j], j
        for j in range(n + 1):
            if is_settled[j] == 1.0:
                lift[owner[j]] += least
                shift[j] -= least
            else:
                path[j] -= least
        now = following
    return int(now)
