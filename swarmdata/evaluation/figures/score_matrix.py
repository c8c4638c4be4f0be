"""A figure of scores by view and algorithm: a matrix of numbers on colors."""

import math
from collections.abc import Mapping
from pathlib import Path

from swarmdata.drawing.style import COLUMN_WIDTH, INK, PAGE_WIDTH, figure

DARK = 0.55
"""Share of the range of colors from which numbers are white."""

CELL = 0.55, 0.2
"""Inches: width and height."""

LETTER_WIDTH = 0.055  # inches, of 7 points


def plot_score_matrix(
    scores: Mapping[str, Mapping[str, float]], path: Path, *, label: str, decimals: int
) -> None:
    """Draws a row for each view and a column for each algorithm; colors begin at 0.

    Args:
        scores: view -> label -> score, in shown units; labels that a view lacks stay empty.
        path: where to save.
        label: of the score.
        decimals: of the numbers.
    """
    labels = list(dict.fromkeys(label for each in scores.values() for label in each))
    values = [[each.get(label, math.nan) for label in labels] for each in scores.values()]
    top = max((value for row in values for value in row if not math.isnan(value)), default=1.0)
    top = max(top, 1.0)
    left, above = (LETTER_WIDTH * max(map(len, names)) for names in (scores, labels))
    width = min(PAGE_WIDTH, max(COLUMN_WIDTH, 0.2 + left + CELL[0] * len(labels)))
    height = 0.5 + 0.75 * above + CELL[1] * len(values)
    with figure(path, width=width, height=height) as drawing:
        axes = drawing.subplots()
        clipped = [[max(value, 0.0) for value in row] for row in values]
        axes.imshow(clipped, cmap="viridis_r", vmin=0.0, vmax=top, aspect="auto")
        for y, row in enumerate(values):
            for x, value in enumerate(row):
                color = "white" if value > DARK * top else INK
                rounded = round(value, decimals) + 0.0  # no -0
                shown = "" if math.isnan(value) else f"{rounded:.{decimals}f}"
                axes.text(x, y, shown, ha="center", va="center", fontsize=7, color=color)
        axes.set_xticks(range(len(labels)), labels, rotation=45, ha="left", rotation_mode="anchor")
        axes.set_yticks(range(len(values)), list(scores))
        axes.tick_params(length=0, top=True, labeltop=True, bottom=False, labelbottom=False)
        axes.spines[:].set_visible(False)
        axes.set_xlabel(f"{label}; the darker, the higher")
