"""Obstacles as convex shapes, which reciprocal avoidance keeps robots from."""

import numpy as np

from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET
from swarmdata.types import Float, Int

N_PRIMITIVES = {CIRCLE: 1, BOX: 1, CORNER: 2, POCKET: 3}


def primitives_of(layout: Float) -> Float:
    """Returns the obstacles of a layout as convex shapes: a corner is 2 boxes, a pocket 3.

    Args:
        layout: obstacles, columns `geometry.OBSTACLE`, [M, 8].

    Returns:
        Circles and boxes, the same columns, [P, 8].
    """
    shapes = [_bar(row, k) for row in layout for k in range(N_PRIMITIVES[float(row[0])])]
    return np.array(shapes, dtype=np.float32).reshape(-1, 8)


def _bar(row: Float, k: int) -> Float:
    """Convex part k of an obstacle: the bar along -y, along -x, or along +x."""
    kind, x, y, ux, uy, a, b, t = (float(value) for value in row)
    if kind in (CIRCLE, BOX):
        return row
    cx, cy, hx, hy = ((0.0, t - b, a, t), (t - a, 0.0, t, b), (a - t, 0.0, t, b))[k]
    centre = (x + cx * ux - cy * uy, y + cx * uy + cy * ux)
    return np.array([BOX, *centre, ux, uy, hx, hy, 0.0], dtype=np.float32)


def n_primitives(kinds: Int) -> int:
    """Number of convex shapes in a layout whose obstacles have these shape codes, [M]."""
    return sum(N_PRIMITIVES[float(kind)] for kind in kinds)
