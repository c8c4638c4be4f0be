"""One estimate against another: points in panels, which a legend names, and the Pareto fronts."""

import math
import textwrap
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    DATA_LINE,
    GRAY,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    figure,
    words_of,
)
from swarmdata.evaluation.figures.dot_plot import HOLLOW_LOOK, Looks, marker_handles
from swarmdata.rollouts.score_statistics import Estimate

MAX_WHOLE_POINTS = 6  # of more points in a panel, only those of its front have intervals

MAX_LARGE_PANELS = 9  # more panels are small ones


MOST_HEIGHT = 5.2  # inches, without the legend, so that a figure is no higher than a screen


class FrontPanel(NamedTuple):
    """The points of a panel."""

    points: Mapping[str, tuple[Estimate, Estimate]]  # label -> (horizontal, vertical), as shown
    front: Collection[str]  # labels that no other exceeds; they are filled, and a line joins them
    line: float | None = None  # vertical place of the mean of the data; None: there is none
    far: Collection[str] = ()  # labels that would dwarf the others, so they are only listed

    @property
    def near(self) -> dict[str, tuple[Estimate, Estimate]]:
        """The points that are drawn."""
        return {label: each for label, each in self.points.items() if label not in self.far}


def plot_fronts(
    panels: Mapping[str, FrontPanel], looks: Looks, path: Path, *, xlabel: str, ylabel: str
) -> None:
    """Draws panels by title: less is better on horizontal axes, from 0, more on vertical ones."""
    are_small = len(panels) > MAX_LARGE_PANELS
    n_rows = math.ceil(len(panels) / (7 if are_small else 3))
    n_columns = math.ceil(len(panels) / n_rows)
    width = COLUMN_WIDTH if n_columns == 1 else PAGE_WIDTH
    shown = {label for panel in panels.values() for label in panel.points}
    legend: dict[str, Mapping[str, Any]] = {
        words_of(label): looks[label] for label in looks if label in shown
    }
    legend["not Pareto-optimal"] = HOLLOW_LOOK
    has_line = any(panel.line is not None for panel in panels.values())
    height = min(0.4 + (1.5 if are_small else 2.2) * n_rows, MOST_HEIGHT)
    with figure(path, width=width, height=height) as drawing:
        grid = drawing.subplots(n_rows, n_columns, squeeze=False).ravel()
        for axes, (title, panel) in zip(grid, panels.items(), strict=False):
            _draw_panel(axes, panel, looks, are_small=are_small)
            xlim, ylim = _limits(panel)
            axes.set(xlim=xlim, ylim=ylim)
            axes.locator_params(nbins=2 if are_small else 6)
            axes.tick_params(labelsize=6.5 if are_small else None)
            words = textwrap.fill(title, 12 if are_small else 30)
            size = 6 if are_small else 7.5
            axes.set_title(words, loc="left", fontweight="bold", fontsize=size)
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        drawing.supxlabel(xlabel, fontsize=8)
        drawing.supylabel(ylabel, fontsize=8)
        draw_legend(drawing, marker_handles(grid[0], legend, 4.5, has_line=has_line))


def _limits(panel: FrontPanel) -> tuple[tuple[float, float], tuple[float, float]]:
    is_crowded = len(panel.near) > MAX_WHOLE_POINTS
    xs, ys = [0.0], [] if panel.line is None else [panel.line]
    for label, (x, y) in panel.near.items():
        whole = label in panel.front or not is_crowded
        xs += (x.value, *(x if whole else ()))
        ys += (y.value, *(y if whole else ()))
    right, low, high = max(xs) or 1.0, min(ys), max(ys)
    margin = 0.08 * (high - low) or 0.5
    return (-0.03 * right, 1.06 * right), (low - margin, high + margin)


def _draw_panel(axes: Any, panel: FrontPanel, looks: Looks, *, are_small: bool) -> None:
    front = sorted((x.value, y.value) for name, (x, y) in panel.near.items() if name in panel.front)
    if front:
        axes.step(*zip(*front, strict=True), where="post", color=GRAY, lw=0.8, zorder=1)
    is_crowded = len(panel.near) > MAX_WHOLE_POINTS
    for label, (x, y) in panel.near.items():
        color, is_best = looks[label]["color"], label in panel.front
        if is_best or not is_crowded:
            axes.plot([x.low, x.high], [y.value] * 2, color=color, alpha=0.5, lw=1.2)
            axes.plot([x.value] * 2, [y.low, y.high], color=color, alpha=0.5, lw=1.2)
        face = color if is_best else "white"
        axes.plot(
            [x.value], [y.value], ms=4.5, mew=0.9, mfc=face, ls="none", zorder=3, **looks[label]
        )
    if panel.line is not None:
        axes.axhline(panel.line, **DATA_LINE, zorder=0)
    draw_grid(axes, width=0.5)
    if panel.far:
        ends = {label: [end.value for end in panel.points[label]] for label in panel.far}
        places = "" if are_small else " ({:.1f}, {:.1f})"
        far = ", ".join(f"{label}{places.format(*end)}" for label, end in ends.items())
        words = textwrap.fill(f"not in view: {far}".replace("-", "−"), 28 if are_small else 200)
        axes.set_xlabel(words, fontsize=5 if are_small else 6, color=GRAY, loc="left")
