"""Lines of sight: whether a segment crosses obstacles. Arithmetic as in `geometry`."""

import numpy as np

from swarmdata.numerics.geometry import CIRCLE, bar_box, outer_radius
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float


@kernel
def crosses_circle(dx: float, dy: float, cx: float, cy: float, r: float) -> bool:
    """Whether the segment from the origin to (dx, dy) crosses a circle about (cx, cy)."""
    square = dx * dx + dy * dy
    s = 0.0 if square == 0.0 else min(max((cx * dx + cy * dy) / square, 0.0), 1.0)
    ex, ey = cx - s * dx, cy - s * dy
    return ex * ex + ey * ey < r * r


@kernel
def _clip(at: float, step: float, half: float, enter: float, leave: float) -> tuple[float, float]:
    """The part of the interval [enter, leave] of s in which at + s * step lies within +-half.

    (Liang and Barsky, "A new concept and method for line clipping", ACM TOG 3(1), 1984.)
    """
    if step == 0.0:
        return (enter, leave) if abs(at) < half else (1.0, 0.0)
    a, b = (-half - at) / step, (half - at) / step
    return max(enter, min(a, b)), min(leave, max(a, b))


@kernel
def crosses_shape(dx: float, dy: float, cx: float, cy: float, row: Double) -> bool:
    """Whether the segment from the origin to (dx, dy), m, crosses the bars of a shape at (cx, cy).

    The shape is a row of a layout, [8], columns `geometry.OBSTACLE`, and no circle.
    """
    ax, ay = row[3], row[4]
    lx, ly = -(cx * ax + cy * ay), -(cy * ax - cx * ay)
    sx, sy = dx * ax + dy * ay, dy * ax - dx * ay
    for index in range(int(row[0])):
        bx, by, hx, hy = bar_box(row[0], row[5], row[6], row[7], index)
        enter, leave = _clip(lx - bx, sx, hx, 0.0, 1.0)
        enter, leave = _clip(ly - by, sy, hy, enter, leave)
        if enter < leave:
            return True
    return False


@kernel
def is_in_sight(px: float, py: float, qx: float, qy: float, layout: Float) -> bool:
    """Whether no obstacle of a layout [M, 8] is between two points, m."""
    dx, dy = qx - px, qy - py
    for m in range(layout.shape[0]):
        row = layout[m].astype(np.float64)
        cx, cy = row[1] - px, row[2] - py
        if crosses_circle(dx, dy, cx, cy, outer_radius(layout[m])) and (
            row[0] == CIRCLE or crosses_shape(dx, dy, cx, cy, row)
        ):
            return False
    return True


@kernel
def sees(x: float, y: float, px: float, py: float, sight_range: float, layout: Float) -> bool:
    """Whether a robot at (x, y) sees the point (px, py): in range, and no obstacle between them."""
    dx, dy = px - x, py - y
    if dx * dx + dy * dy > sight_range * sight_range:
        return False
    return bool(is_in_sight(x, y, px, py, layout))
