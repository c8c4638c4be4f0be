"""Lines with intervals over numbers, a panel for each axis, with labels at the lines' ends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmdata.drawing.line_labels import label_ends
from swarmdata.drawing.style import PAGE_WIDTH, draw_grid, figure
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.rollouts.score_statistics import Estimate

N_COLUMNS = 3
PANEL_HEIGHT = 1.9  # inches
MOST_TICKS = 6  # at the numbers themselves; of more numbers, ticks are at round ones


@dataclass(frozen=True)
class LinePanel:
    """What one panel shows.

    Attributes:
        title: above it.
        xlabel: below it.
        lines: label -> number -> estimate, in shown units.
        falls: whether numbers fall from left to right, so that conditions get worse.
    """

    title: str
    xlabel: str
    lines: Mapping[str, Mapping[float, Estimate]]
    falls: bool = False


def plot_line_panels(panels: Sequence[LinePanel], looks: Looks, path: Path, *, ylabel: str) -> None:
    """Draws the panels on one vertical axis.

    Args:
        panels: at least one.
        looks: color and marker of each label.
        path: where to save.
        ylabel: of all panels.
    """
    n_columns = min(N_COLUMNS, len(panels))
    n_rows = -(-len(panels) // n_columns)
    height = n_rows * (PANEL_HEIGHT + 0.65)
    with figure(path, width=PAGE_WIDTH, height=height) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False, sharey=True)
        for axes, panel in zip(grid.flat, panels, strict=False):
            _draw(axes, panel, looks)
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_visible(False)
        for axes in list(grid.flat)[: len(panels)]:  # the limits of the shared axis are final
            label_ends(axes, axes.get_lines(), PANEL_HEIGHT)
        for axes in grid[:, 0]:
            axes.set_ylabel(ylabel)


def _draw(axes: Any, panel: LinePanel, looks: Looks) -> None:
    for label, points in panel.lines.items():
        x = sorted(points, reverse=panel.falls)
        found, look = [points[value] for value in x], looks[label]
        axes.plot(x, [each.value for each in found], ms=4, lw=1.4, label=label, **look)
        low, high = [each.low for each in found], [each.high for each in found]
        axes.fill_between(x, low, high, color=look["color"], alpha=0.13, lw=0)
    numbers = sorted({value for points in panel.lines.values() for value in points})
    if len(numbers) <= MOST_TICKS:
        axes.set_xticks(numbers, [f"{value:g}" for value in numbers])
    if panel.falls:
        axes.invert_xaxis()
    axes.set_title(panel.title, loc="left", fontsize=7.5, fontweight="bold")
    draw_grid(axes, width=0.5)
    axes.set_xlabel(panel.xlabel)
