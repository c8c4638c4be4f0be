"""Distances between circular robots, obstacles and walls.

All arithmetic is `+ - * /` and `sqrt` in the wider type of the operands (numba's `float()` does not
widen), which IEEE 754 rounds correctly: the bits are the same on every platform.
"""

import math

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Column, Double, Float

CIRCLE, BOX, CORNER, POCKET = 0.0, 1.0, 2.0, 3.0
"""Shape codes, equal to the number of bars. A corner has bars along the lower and left sides of its
rectangle; a pocket has one along the right side too, so that it opens towards local +y."""

SHAPE_MEANINGS = (
    "circle: a disc of radius a",
    "box: the rectangle |x| <= a, |y| <= b",
    "corner: an L of two bars, |x| <= a, |y - (t - b)| <= t and |x - (t - a)| <= t, |y| <= b",
    "pocket: a U of three bars, those of a corner and |x - (a - t)| <= t, |y| <= b",
)
"""The points of an obstacle, by shape code; x and y are in its local frame."""

OBSTACLE_COLUMNS = (
    Column("kind", "shape: an index into `shapes`", low=0, high=3),
    Column("x", "centre, x", "m", frame="world"),
    Column("y", "centre, y", "m", frame="world"),
    Column("ux", "direction of the local x axis, a unit vector, x", "", -1, 1, "world"),
    Column("uy", "the same, y; the local y axis is (-uy, ux)", "", -1, 1, "world"),
    Column("a", "radius of a circle; else half length along the local x axis", "m", low=0),
    Column("b", "half width along the local y axis; the radius of a circle", "m", low=0),
    Column("t", "half thickness of the bars of a corner or pocket, else 0", "m", low=0),
)
"""Columns of a layout row: an obstacle's shape, place and size."""

OBSTACLE = tuple(column.name for column in OBSTACLE_COLUMNS)  # names of the columns of a layout row


@kernel(inline="always")
def bar_box(kind: float, a: float, b: float, t: float, k: int) -> tuple[float, float, float, float]:
    """Centre and half sizes of bar k in the obstacle's frame: along -y, then -x, then +x."""
    if kind <= BOX:
        return 0.0, 0.0, a, b
    if k == 0:
        return 0.0, t - b, a, t
    return (t - a if k == 1 else a - t), 0.0, t, b


@kernel(inline="always")
def _bar(lx: float, ly: float, cx: float, cy: float, hx: float, hy: float) -> tuple[float, float]:
    """Vector from the local point to the nearest point of an axis-aligned bar."""
    qx = min(max(lx, cx - hx), cx + hx)
    qy = min(max(ly, cy - hy), cy + hy)
    return qx - lx, qy - ly


@kernel(inline="always")
def nearest_of_shape(
    px: float,
    py: float,
    kind: float,
    x: float,
    y: float,
    ux: float,
    uy: float,
    a: float,
    b: float,
    t: float,
) -> tuple[float, float, float]:
    """As `nearest`, for an obstacle given by its columns `OBSTACLE`."""
    dx, dy = x - px, y - py
    if kind == CIRCLE:
        d = math.sqrt(dx * dx + dy * dy)
        if d <= a:
            return 0.0, 0.0, 0.0
        s = (d - a) / d
        return d - a, dx * s, dy * s
    lx, ly = -(dx * ux + dy * uy), -(dy * ux - dx * uy)
    if kind == BOX:
        vx, vy = _bar(lx, ly, 0.0, 0.0, a, b)
    else:
        vx, vy = _bar(lx, ly, 0.0, t - b, a, t)
        wx, wy = _bar(lx, ly, t - a, 0.0, t, b)
        if wx * wx + wy * wy < vx * vx + vy * vy:
            vx, vy = wx, wy
        if kind == POCKET:
            wx, wy = _bar(lx, ly, a - t, 0.0, t, b)
            if wx * wx + wy * wy < vx * vx + vy * vy:
                vx, vy = wx, wy
    return math.sqrt(vx * vx + vy * vy), vx * ux - vy * uy, vx * uy + vy * ux


@kernel(error_model="numpy")
def nearest_of(px: float, py: float, layout: Float, m: int) -> tuple[float, float, float]:
    """As `nearest`, for obstacle m of a layout [M, 8]; a slice of the layout would be slower."""
    return nearest_of_shape(
        px, py, layout[m, 0], layout[m, 1], layout[m, 2], layout[m, 3], layout[m, 4],
        layout[m, 5], layout[m, 6], layout[m, 7],
    )  # fmt: skip


@kernel(error_model="numpy")
def nearest(px: float, py: float, row: Float) -> tuple[float, float, float]:
    """Returns the distance from a point (m) to an obstacle's surface and the vector to it.

    The distance is 0 inside an obstacle, `row` [8]. If two bars of a corner or pocket are equally
    near, the vector leads to the first.
    """
    return nearest_of_shape(px, py, row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7])


@kernel
def bounding_radius(row: Float) -> float:
    """Radius of the smallest circle around the obstacle's centre that contains it."""
    a, b = float(row[5]), float(row[6])
    return a if row[0] == CIRCLE else math.sqrt(a * a + b * b)


@kernel(inline="always")
def outer_radius(row: Float) -> float:
    """An upper bound of `bounding_radius`, at most 42 % larger, computed without a square root."""
    a, b = float(row[5]), float(row[6])
    return a if row[0] == CIRCLE else 1.4143 * max(a, b)


@kernel
def wall_gap(px: float, py: float, half: Double, wall: int) -> float:
    """Distance from a point to the inner face of one wall: 0 right, 1 left, 2 top, 3 bottom.

    `half` is half the width and half the height of the arena, m, [2].
    """
    if wall == 0:
        return half[0] - px
    if wall == 1:
        return half[0] + px
    if wall == 2:
        return half[1] - py
    return half[1] + py


@kernel
def clearance(px: float, py: float, layout: Float, half: Double) -> float:
    """Distance from a point to the nearest obstacle of a layout [M, 8] or wall, m.

    `half` is half the width and half the height of the arena, m, [2].
    """
    best = min(half[0] - abs(px), half[1] - abs(py))
    for m in range(layout.shape[0]):
        dx, dy = float(layout[m, 1]) - px, float(layout[m, 2]) - py
        reach = best + bounding_radius(layout[m])
        if reach > 0.0 and dx * dx + dy * dy < reach * reach:
            best = min(best, nearest(px, py, layout[m])[0])
    return best
