"""Names of lines, written where the lines end instead of in a legend."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarmdata.drawing.style import words_of
from swarmdata.types import Double

NEAR_SIDE = 0.98  # share of a panel's width, up to which a line ends before the panel does

MIN_LABEL_GAP = 8.5 / 72  # inches between the middles of two labels


def label_ends(axes: Any, lines: Sequence[Any], height: float) -> None:
    """Writes each line's label beside a panel, `height` inches high and with final limits.

    Labels do not overlap; a line that ends before the panel does is joined to its own.
    """
    transform = axes.transData
    inverse = axes.transAxes.inverted()
    ends = [(line.get_xdata()[-1], line.get_ydata()[-1]) for line in lines]
    wanted = np.array([inverse.transform(transform.transform(end))[1] for end in ends])
    places = spread_labels(np.clip(wanted, 0.0, 1.0), MIN_LABEL_GAP / height)
    for line, end, place in zip(lines, ends, places, strict=True):
        look = {"va": "center", "fontsize": 7, "color": line.get_color(), "annotation_clip": False}
        beside = {"xycoords": "axes fraction", "xytext": (4, 0), "textcoords": "offset points"}
        text = words_of(str(line.get_label()))
        axes.annotate(text, (1.0, place), **beside, **look)
        if inverse.transform(transform.transform(end))[0] < NEAR_SIDE:
            leader = {"arrowstyle": "-", "ls": ":", "lw": 0.7, "color": line.get_color(),
                      "shrinkA": 0.0, "shrinkB": 0.0}  # fmt: skip
            axes.annotate("", end, (1.0, place), textcoords="axes fraction", arrowprops=leader)


def spread_labels(wanted: Double, gap: float) -> Double:
    """Places labels at least `gap` apart, in their order and as near to `wanted` as possible.

    Isotonic regression by least squares: without the gaps the places must not decrease, which
    pooling adjacent violators solves (Barlow, Bartholomew, Bremner and Brunk, "Statistical
    Inference under Order Restrictions", 1972, section 1.2). The labels stay within [0, 1] if
    they fit.
    """
    order = np.argsort(wanted, kind="stable")
    steps = gap * np.arange(len(wanted))
    blocks: list[tuple[float, int]] = []  # mean and number of the labels in a block
    for value in (wanted[order] - steps).tolist():
        mean, n = value, 1
        while blocks and blocks[-1][0] > mean:
            before, m = blocks.pop()
            mean, n = (before * m + mean * n) / (m + n), m + n
        blocks.append((mean, n))
    level = np.repeat([mean for mean, _ in blocks], [n for _, n in blocks])
    places = np.empty(len(wanted))
    places[order] = np.clip(level, 0.0, max(0.0, 1.0 - steps[-1])) + steps
    return places
