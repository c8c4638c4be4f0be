"""Differences of all pairs of labels, as a matrix."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmdata.drawing.style import COLUMN_WIDTH, INK, PAGE_WIDTH, figure
from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_statistics import Estimate

CELL = 0.36, 0.2
"""Inches: width and height."""

LETTER_WIDTH = 0.055  # inches, of 7 points


def plot_difference_matrix(
    labels: Sequence[str], pairs: Mapping[tuple[str, str], Estimate], path: Path
) -> None:
    """Draws row minus column for each row above its column; white if it may be 0.

    Args:
        labels: from the best.
        pairs: (row, column) -> difference of scores.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there are fewer than two labels, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if len(labels) < 2:
        raise SchemaError(f"got the labels {list(labels)} to compare, expected at least two.")
    rows, columns = labels[:-1], labels[1:]
    n, room = len(rows), LETTER_WIDTH * max(map(len, labels))
    limit = max(abs(found.value) for found in pairs.values()) or 1.0
    width = min(PAGE_WIDTH, max(COLUMN_WIDTH, 0.2 + room + CELL[0] * n))
    with figure(path, width=width, height=0.4 + 0.7 * room + CELL[1] * n) as drawing:
        axes = drawing.add_subplot()
        shown = np.full((n, n), np.nan)
        for row, one in enumerate(rows):
            for column in range(row, n):
                found = pairs[one, columns[column]]
                is_decided = found.low > 0.0 or found.high < 0.0
                shown[row, column] = found.value if is_decided else 0.0
                axes.text(
                    column,
                    row,
                    f"{found.value:+.0f}".replace("-", "−"),
                    ha="center",
                    va="center",
                    fontsize=7,
                    fontweight="bold" if is_decided else "normal",
                    color="white" if is_decided and abs(found.value) > 0.45 * limit else INK,
                )
        axes.imshow(shown, cmap="PuOr", vmin=-limit, vmax=limit, aspect="auto")
        axes.set_xticks(range(n), columns, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(n), rows)
        axes.set_title("score of row minus column; bold: clearly not 0", loc="left", fontsize=7.5)
        for side in axes.spines.values():
            side.set_visible(False)
        axes.tick_params(length=0)
