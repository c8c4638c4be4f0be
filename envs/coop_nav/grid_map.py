"""Maps of square cells: walls as few boxes, and starts and goals anywhere between them.

Free cells outside of their largest connected part are walls, so that goals can be reached.
"""

from collections.abc import Sequence

import numpy as np

from swarmdata.envs.world.spawn import check_fixed_layout
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import BOX
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Float

LEAST_CELLS = 4  # free cells for each robot, so that starts and goals find places
CELL_MARGIN = 0.1  # smallest excess width (m) of a cell over a robot with its clearance


def walls_on_map(spec: TaskSpec, rows: Sequence[str], cell: float) -> Float:
    """Returns the walls of a map, [M, 8], between which a spec's robots start.

    `rows`: of the map, the first at the top; `.` is free. `cell`: side of a cell, m.

    Raises:
        SpecError: the spec has other obstacles or another arena, or robots do not fit.
    """
    check_fixed_layout(spec, "arrangement 'map'")
    free = largest_part(rows)
    height, width = (cell * n for n in free.shape)
    if not np.allclose((spec.arena.width, spec.arena.height), (width, height), rtol=0, atol=1e-6):
        raise SpecError(
            f"the arena has {spec.arena.width:g} m x {spec.arena.height:g} m, expected {width:g} m "
            f"x {height:g} m, for {free.shape[1]} x {free.shape[0]} cells of {cell:g} m. Write "
            f"arena: {{width: {width:g}, height: {height:g}}}."
        )
    room = max(spec.spawn.start_clearance, spec.spawn.goal_clearance)
    need = 2.0 * (max(robot.radius for robot in spec.robots) + room) + CELL_MARGIN
    if cell < need:
        raise SpecError(
            f"arrangement.cell is {cell:g} m, expected at least {need:.2f} m, so that the largest "
            f"robot can start in a cell, {room:g} m from its walls. Enlarge it, or reduce "
            "spawn.start_clearance and spawn.goal_clearance."
        )
    if free.sum() < LEAST_CELLS * spec.n_agents:
        raise SpecError(
            f"the largest part of the map has {free.sum()} free cells, expected at least "
            f"{LEAST_CELLS * spec.n_agents} for {spec.n_agents} robots"
        )
    return walls(rows, cell)


def largest_part(rows: Sequence[str]) -> Bool:
    """Which cells are in the largest connected part of the free ones, [rows, columns].

    Cells are connected where they share a side; of parts of one size, the first counts.
    """
    free = np.array([list(row) for row in rows]) == "."
    parts, n_parts = np.zeros(free.shape, np.int64), 0
    for start in map(tuple, np.argwhere(free)):
        if parts[start]:
            continue
        n_parts += 1
        parts[start], left = n_parts, [start]
        while left:
            i, j = left.pop()
            for near in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                inside = 0 <= near[0] < free.shape[0] and 0 <= near[1] < free.shape[1]
                if inside and free[near] and not parts[near]:
                    parts[near] = n_parts
                    left.append(near)
    sizes = np.bincount(parts.ravel(), minlength=2)
    return (parts == 1 + sizes[1:].argmax()) & free


def walls(rows: Sequence[str], cell: float) -> Float:
    """Returns boxes that cover all cells outside of `largest_part`, and no other, [M, 8].

    A run of cells in a row is one box with the same runs in the rows below it.
    """
    blocked = ~largest_part(rows)
    n_rows, n_columns = blocked.shape
    boxes = []
    for i in range(n_rows):
        for j in range(n_columns):
            if not blocked[i, j]:
                continue
            right = j
            while right < n_columns and blocked[i, right]:
                right += 1
            below = i
            while below < n_rows and _is_run(blocked[below], j, right):
                blocked[below, j:right] = False
                below += 1
            x = cell * ((j + right) / 2 - n_columns / 2)
            y = cell * (n_rows / 2 - (i + below) / 2)
            half = cell * (right - j) / 2, cell * (below - i) / 2
            boxes.append((BOX, x, y, 1.0, 0.0, *half, 0.0))
    return np.array(boxes, np.float32).reshape(-1, 8)


def _is_run(row: Bool, first: int, end: int) -> bool:
    """Whether the cells from `first` to `end` are blocked, and those beside them are not."""
    beside = row[max(first - 1, 0) : first].any() or row[end : end + 1].any()
    return bool(row[first:end].all() and not beside)
