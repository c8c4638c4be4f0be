"""The figure that most answers have: differences with intervals, a row each, beside 0."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmdata.drawing.style import COLORS, DATA_LINE, GRAY, draw_grid, figure
from swarmdata.evaluation.study.pages.row_differences import verdict_of
from swarmdata.rollouts.score_statistics import Estimate

VERDICT_COLORS = {"higher": COLORS[0], "lower": COLORS[1], "no clear change": GRAY}
"""Of a difference that is above 0 with its whole interval, below it, or neither."""


def plot_differences_from_zero(
    rows: Sequence[str], panels: Mapping[str, Sequence[Estimate]], path: Path
) -> None:
    """Draws differences: a panel for each quantity, a row for each comparison, the first on top.

    Args:
        rows: names of the comparisons.
        panels: label of the axis -> difference of each row, in shown units; NaN is left out.
        path: where to save.
    """
    height = 1.2 + 0.24 * len(rows)
    width = 1.4 + 0.065 * max(map(len, rows)) + 2.2 * len(panels)
    with figure(path, width=width, height=height) as drawing:
        grid = drawing.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axes, (label, differences) in zip(grid, panels.items(), strict=True):
            axes.axvline(0.0, **DATA_LINE, zorder=0)
            for y, each in enumerate(differences):
                _draw(axes, each, y)
            draw_grid(axes, "x", width=0.6)
            axes.set_xlabel(label, fontsize=9)
            axes.tick_params(axis="y", length=0, labelsize=8)
        grid[0].set_yticks(range(len(rows)), rows)
        grid[0].set_ylim(len(rows) - 0.5, -0.5)
        handles = [
            grid[0].plot([], [], "o", color=color, ms=5, label=verdict)[0]
            for verdict, color in VERDICT_COLORS.items()
        ]
        drawing.legend(handles=handles, loc="outside upper center", ncols=len(handles))


def _draw(axes: Any, difference: Estimate, y: int) -> None:
    color = VERDICT_COLORS[verdict_of(difference)]
    axes.plot([difference.low, difference.high], [y, y], color=color, lw=2.2, alpha=0.55)
    axes.plot([difference.value], [y], "o", color=color, ms=5)
