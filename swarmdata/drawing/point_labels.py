"""Names of points, written beside them where they cover the least."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from swarmdata.types import Bool, Double

DISTANCES = (4.0, 8.0, 13.0)
"""Between a point and its name, in points, the nearest first."""

NAME_COST, POINT_COST, LINE_COST, DISTANCE_COST = 4.0, 1.0, 0.1, 0.02
"""Of covering another name, a marker, a point on a line, and of each place that is tried before."""

MARKER_RADIUS = 2.0
"""Of what a name should not cover, in points."""

Point = tuple[float, float]


def label_points(
    axes: Any,
    named: Mapping[str, Point],
    colors: Mapping[str, str],
    others: Sequence[Point],
    lines: Sequence[Point],
) -> None:
    """Writes names beside points: each at the place where it covers the least, the highest first.

    Args:
        axes: the panel, laid out by `figure.draw_without_rendering`, so that pixels are final.
        named: name -> point, in the units of the axes.
        colors: name -> color of the name.
        others: points without names, which names should not cover either.
        lines: points on lines, which names should rather not cover.
    """
    from matplotlib.patheffects import withStroke  # noqa: PLC0415  (matplotlib is an extra)

    scale = axes.figure.dpi / 72
    points = [*named.values(), *others, *lines]
    places = np.array([axes.transData.transform(point) for point in points])
    weights = np.array([POINT_COST] * (len(points) - len(lines)) + [LINE_COST] * len(lines))
    panel = np.array(axes.get_window_extent().extents)
    taken: list[Double] = []
    for name in sorted(named, key=lambda each: (-named[each][1], named[each][0], each)):
        text = axes.annotate(
            name, named[name], xytext=(0, 0), textcoords="offset points",
            ha="center", va="center", fontsize=7, color=colors[name], zorder=5,
        )  # fmt: skip
        text.set_in_layout(False)
        text.set_path_effects([withStroke(linewidth=1.5, foreground="white")])
        half = np.array(text.get_window_extent().size) / 2 + scale
        at = axes.transData.transform(named[name])
        offsets = _offsets(half, scale)
        costs = [
            _cost(_box(at + move, half), taken, panel)
            + float(weights @ _is_near(_box(at + move, half), places, MARKER_RADIUS * scale))
            + DISTANCE_COST * k
            for k, move in enumerate(offsets)
        ]
        chosen = offsets[int(np.argmin(costs))]
        text.xyann = tuple(chosen / scale)
        taken.append(_box(at + chosen, half))


def _offsets(half: Double, scale: float) -> list[Double]:
    """Places around a point, in pixels: beside it, above, below, at its corners, then farther."""
    directions = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
    return [
        np.array(way, np.float64) * (half + distance * scale * (0.5 if all(way) else 1.0))
        for distance, way in product(DISTANCES, directions)
    ]


def _box(middle: Double, half: Double) -> Double:
    return np.concatenate([middle - half, middle + half])


def _overlap(one: Double, other: Double) -> float:
    """The area that two boxes [left, bottom, right, top] share."""
    size = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    return float(np.prod(np.maximum(size, 0.0)))


def _cost(box: Double, taken: Sequence[Double], panel: Double) -> float:
    """How much of a name is over others, or outside of the panel, as a share of its area."""
    area = float(np.prod(box[2:] - box[:2]))
    covered = sum(_overlap(box, other) for other in taken)
    return NAME_COST * (covered + area - _overlap(box, panel)) / area


def _is_near(box: Double, places: Double, radius: float) -> Bool:
    """Which places are in a box or nearer to it than a radius."""
    return np.asarray(((places > box[:2] - radius) & (places < box[2:] + radius)).all(axis=1))
