"""Dot plots: rows of estimates with intervals, in panels that can share their limits."""

import math
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    DATA_LINE,
    FAINT,
    GRAY,
    INK,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    family_name,
    figure,
    words_of,
)
from swarmdata.rollouts.score_statistics import Estimate

Looks = Mapping[str, Mapping[str, str]]  # color and marker of each label, from `family_looks`

ROW_HEIGHT, LOWEST_ROW = 0.155, 0.105  # inches; rows are as low as the screen needs
SCREEN_HEIGHT = 5.5  # inches: of a figure without its legend, so that it has 1,200 pixels at most
MAX_PANELS_IN_A_LINE = 4

LETTER_WIDTH = 0.055  # inches, of 7 points


class Panel(NamedTuple):
    """One quantity of the rows of a line."""

    estimates: Mapping[str, Estimate]  # by row, in shown units; rows may be absent, values NaN
    xlabel: str  # of the horizontal axis
    title: str = ""  # above the panel
    line: float | None = None  # where the mean of the data is; None: there is none
    scale: str = ""  # panels of one scale have the same limits; empty: limits of its own
    limits: tuple[float | None, float | None] = (None, None)  # None: as far as intervals reach
    hollow: Collection[str] = ()  # rows whose markers are not filled


class PanelLine(NamedTuple):
    """Panels side by side, which share their rows, the first one on top."""

    rows: Sequence[str]
    panels: Sequence[Panel]


def plot_by_dataset(
    estimates: Mapping[str, Mapping[str, Estimate]],
    data: Mapping[str, float],
    looks: Looks,
    path: Path,
    *,
    label: str,
    families: Mapping[str, str] = {},
    shares_axis: bool = True,
) -> None:
    """Draws one quantity: a panel for each dataset, a row for each algorithm, the best on top.

    `estimates` are by dataset and algorithm, `data` the means of a dataset's own episodes, `label`
    is that of the horizontal axes, which panels may share, and `families` are for the legend.
    """
    values: dict[str, list[float]] = {}
    for found in estimates.values():
        for name, each in found.items():
            values.setdefault(name, []).append(each.value)
    rows = sorted(values, key=lambda name: (-sum(values[name]) / len(values[name]), name))
    panels = [
        Panel(found, label, dataset, data.get(dataset), "all" if shares_axis else "")
        for dataset, found in estimates.items()
    ]
    starts = range(0, len(panels), MAX_PANELS_IN_A_LINE)
    lines = [PanelLine(rows, panels[k : k + MAX_PANELS_IN_A_LINE]) for k in starts]
    known = {name: kind for name, kind in families.items() if name in values}
    plot_dots(lines, looks, path, legend=family_legend(known, looks))


def family_legend(families: Mapping[str, str], looks: Looks) -> dict[str, Mapping[str, Any]]:
    """Family -> look of its color; empty if every label is a family of its own."""
    if len(set(families.values())) == len(families):
        return {}
    return {
        family_name(family) or "algorithms": {"color": looks[name]["color"], "marker": "o"}
        for name, family in families.items()
    }


def plot_dots(
    lines: Sequence[PanelLine],
    looks: Looks,
    path: Path,
    *,
    legend: Mapping[str, Mapping[str, Any]],
    zero: bool = False,
) -> None:
    """Draws lines of panels from the top, perhaps with a line at 0; rows without a look are dark.

    `legend` has looks by text; the mean of the data is added if it is drawn.
    """
    n_columns = max(len(line.panels) for line in lines)
    width = COLUMN_WIDTH if n_columns == 1 else PAGE_WIDTH
    letters = max(len(words_of(row)) for line in lines for row in line.rows)
    room = (width - LETTER_WIDTH * letters) / n_columns  # of a panel
    lines = [_wrapped(line, room) for line in lines]
    row_height = _row_height(lines)
    heights = [row_height * (len(line.rows) + 0.4) for line in lines]
    limits = _limits([panel for line in lines for panel in line.panels], zero=zero)
    height = sum(heights) + sum(map(_decoration, lines)) + 0.5
    with figure(path, width=width, height=height) as drawing:
        grid = drawing.subplots(len(lines), n_columns, squeeze=False, height_ratios=heights)
        for k, line in enumerate(lines):
            for column, axes in enumerate(grid[k]):
                if column >= len(line.panels):
                    axes.set_visible(False)
                    continue
                panel = line.panels[column]
                _draw_panel(axes, line.rows, panel, looks, zero=zero)
                axes.set_xlim(*limits[panel.scale or id(panel)])
                axes.tick_params(axis="y", length=0, labelleft=column == 0)
                below = lines[k + 1].panels[column : column + 1] if k + 1 < len(lines) else ()
                _label_axis(axes, panel, below)
        has_line = any(panel.line is not None for line in lines for panel in line.panels)
        draw_legend(drawing, marker_handles(grid[0, 0], legend, 4.2, has_line=has_line))


def _wrapped(line: PanelLine, width: float) -> PanelLine:
    """Breaks titles at hyphens and spaces, so that they fit into a panel's width in inches."""
    if not any(panel.title for panel in line.panels[1:]):  # it may run over the next panels
        width *= len(line.panels)
    letters = max(8, int(width / (1.3 * LETTER_WIDTH)))
    panels = [each._replace(title=textwrap.fill(each.title, letters)) for each in line.panels]
    return line._replace(panels=panels)


def _decoration(line: PanelLine) -> float:
    title = max(panel.title.count("\n") + 1 if panel.title else 0 for panel in line.panels)
    return 0.14 * title + 0.22


def _row_height(lines: Sequence[PanelLine]) -> float:
    """As high as fits onto a screen, between the lowest and the usual row, in inches."""
    room = SCREEN_HEIGHT - 0.5 - sum(map(_decoration, lines))
    n_rows = sum(len(line.rows) + 0.4 for line in lines)
    return min(ROW_HEIGHT, max(LOWEST_ROW, room / n_rows))


def fits_on_a_screen(n_rows: int, n_lines: int) -> bool:
    """Whether so many lines of panels with so many rows are no higher than a screen."""
    line = LOWEST_ROW * (n_rows + 0.4) + 0.36
    return n_lines * line + 0.5 <= SCREEN_HEIGHT


def _limits(panels: Iterable[Panel], *, zero: bool) -> dict[str | int, tuple[float, float]]:
    scales: dict[str | int, list[Panel]] = {}
    for panel in panels:
        scales.setdefault(panel.scale or id(panel), []).append(panel)
    limits = {}
    for key, group in scales.items():
        ends = [end for panel in group for each in panel.estimates.values() for end in each]
        ends += [panel.line for panel in group if panel.line is not None]
        known = [end for end in ends if math.isfinite(end)] + [0.0] * zero
        first, last = group[-1].limits
        low = first if first is not None else min(known, default=0.0)
        high = last if last is not None else max(known, default=1.0)
        margin = 0.04 * (high - low) or 0.5
        limits[key] = low - margin, high + margin
    return limits


def _draw_panel(axes: Any, rows: Sequence[str], panel: Panel, looks: Looks, *, zero: bool) -> None:
    for y, row in enumerate(rows):
        axes.axhline(y, color=FAINT, lw=0.5, zorder=0)
        if row in panel.estimates:
            look = looks.get(row, {"color": INK, "marker": "o"})
            _draw_dot(axes, panel.estimates[row], y, look, is_hollow=row in panel.hollow)
    if zero:
        axes.axvline(0.0, color=INK, lw=0.8, zorder=1)
    if panel.line is not None:
        axes.axvline(panel.line, **DATA_LINE, zorder=1)
    axes.set_title(panel.title, loc="left", fontweight="bold", fontsize=7.5)
    axes.set_yticks(range(len(rows)), [words_of(row) for row in rows])
    axes.set_ylim(len(rows) - 0.3, -0.7)
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=6)
    draw_grid(axes, "x", width=0.5)


def _draw_dot(
    axes: Any, estimate: Estimate, y: int, look: Mapping[str, str], *, is_hollow: bool
) -> None:
    color = look["color"]
    axes.plot([estimate.low, estimate.high], [y, y], color=color, lw=1.6, alpha=0.55, zorder=2)
    unknown = math.isnan(estimate.low)  # no interval: not a measured policy
    face = "white" if is_hollow or unknown else color
    axes.plot([estimate.value], [y], ls="none", ms=4.2, mew=0.9, mfc=face, zorder=3, **look)


def _label_axis(axes: Any, panel: Panel, below: Sequence[Panel]) -> None:
    """Labels the axis, unless the panel below has the same."""
    is_same = bool(below) and bool(panel.scale) and below[0].scale == panel.scale
    axes.tick_params(axis="x", labelbottom=not is_same)
    if not (below and below[0].xlabel == panel.xlabel):
        axes.set_xlabel(panel.xlabel)


def marker_handles(
    axes: Any, legend: Mapping[str, Mapping[str, Any]], size: float, *, has_line: bool
) -> list[Any]:
    """Handles of a legend: markers of a size in points, and the mean of the data."""
    handles = [
        axes.plot([], [], **{"ls": "none", "ms": size, "mew": 0.9, **look}, label=text)[0]
        for text, look in legend.items()
    ]
    return handles + (axes.plot([], [], **DATA_LINE, label="mean of the data") if has_line else [])


HOLLOW_LOOK: Mapping[str, Any] = {"color": GRAY, "marker": "o", "mfc": "white"}
"""Of the entry in a legend that says what hollow markers are."""
