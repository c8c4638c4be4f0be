"""Figures of a result set: scores, performance profiles, comparisons, Pareto fronts, estimates.

A label has the same color and marker in all of them.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import (
    COLORS,
    DATA_LINE,
    FAINT,
    GRAY,
    INK,
    MARKERS,
    draw_grid,
    figure,
    line_style,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.aggregates import (
    Point,
    differences,
    pareto,
    performance_profile,
    thresholds_of,
)
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version
from swarmdata.types import Double

MAX_DISTANCE_IN_VIEW = 0.6
"""Of a return from those that learned from data, as a share of their range."""

MARKER_DISTANCE = 40
"""Thresholds between two markers of a profile."""

BASELINE_MARKERS = ("X", "p", "*", "<", ">", "h", "d")
"""Of labels that learned from no data, which are all gray."""


def looks_of(trained: Collection[str], others: Collection[str] = ()) -> dict[str, dict[str, Any]]:
    """Returns the color and marker of each label, by name, so that all figures of a report agree.

    Args:
        trained: labels that learned from data; they vary in color, then in marker.
        others: labels that did not; all are gray.
    """
    looks = {
        label: {
            "color": COLORS[k % len(COLORS)],
            "marker": MARKERS[(k // len(COLORS)) % len(MARKERS)],
        }
        for k, label in enumerate(sorted(trained))
    }
    for k, label in enumerate(sorted(set(others) - set(trained))):
        looks[label] = {"color": GRAY, "marker": BASELINE_MARKERS[k % len(BASELINE_MARKERS)]}
    return looks


def plot_scores(results: ResultSet, path: Path) -> None:
    """Draws the score of every label on every dataset with its interval, and the mean of the data.

    Args:
        results: to draw; datasets without a score are left out.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: no dataset has a score, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    cases = [case for case in results.cases if case.reference is not None]
    if not cases:
        raise SchemaError("no dataset has scores to draw: no references were measured.")
    looks, span = looks_of(results.labels), 0.76
    slot = span / max(len(results.labels), 1)
    width = 1.2 + len(cases) * max(1.0, 0.17 * len(results.labels) + 0.35)
    with figure(path, width=max(5.2, width), height=4.2) as drawing:
        axes = drawing.add_subplot()
        for height in (0.0, 100.0):
            axes.axhline(height, color=FAINT, lw=1.2, zorder=0)
        for place, case in enumerate(cases):
            _draw_data(axes, case, place, span)
            for k, label in enumerate(results.labels):
                if label in case.runs:
                    x = place + (k + 0.5) * slot - span / 2
                    found = mean_interval(case.scores(label))
                    axes.plot([x, x], [found.low, found.high], color=looks[label]["color"], lw=1.6)
                    axes.plot([x], [found.value], **{"ms": 5, "ls": "none", **looks[label]})
        _name_datasets(axes, [case.name for case in cases])
        axes.set_ylabel("score (0 no skill, 100 expert)")
        draw_grid(axes, "y", width=0.6)
        shown = {label: looks[label] for label in results.labels}
        _legend(axes, shown, extra=any(case.data_score is not None for case in cases))


def _draw_data(axes: Any, case: Case, place: int, span: float) -> None:
    """The mean of the dataset's own episodes as a line across its labels."""
    if case.data_score is not None:
        ends = [place - span / 2, place + span / 2]
        axes.plot(ends, [case.data_score] * 2, **DATA_LINE, zorder=1)


def _name_datasets(axes: Any, names: Sequence[str]) -> None:
    """Writes ids below their places, on two lines and without the version."""
    short = [without_version(name).replace("-mini", "\nmini") for name in names]
    axes.set_xticks(range(len(names)), [name.replace("-", "\n", 1) for name in short], fontsize=9)
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.tick_params(axis="x", length=0)


def _legend(axes: Any, looks: Mapping[str, Mapping[str, Any]], *, extra: bool) -> None:
    handles = [_legend_handle(axes, look, label) for label, look in looks.items()]
    if extra:
        handles.append(_legend_handle(axes, DATA_LINE, "mean of the data"))
    axes.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=min(5, len(handles)),
        handletextpad=0.4,
        columnspacing=1.2,
    )


def _legend_handle(axes: Any, look: Mapping[str, Any], label: str) -> Any:
    """A legend's entry for a label."""
    return axes.plot([], [], **{"ms": 5, "ls": "none", **look}, label=label)[0]


def plot_profiles(
    tables: Mapping[str, Double], path: Path, looks: Mapping[str, Mapping[str, Any]] | None = None
) -> None:
    """Draws the share of the measured runs that score above each threshold.

    Args:
        tables: label -> scores [runs, datasets, episodes], such as `ComparableScores.tables`.
        path: where to save; the suffix is the format.
        looks: color and marker of each label; None: colors and dashes by name.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    runs = {label: table.mean(axis=-1) for label, table in tables.items()}
    thresholds = thresholds_of(runs)
    with figure(path, width=6.4, height=3.9) as drawing:
        axes = drawing.add_subplot()
        order = sorted(runs)
        for k, (label, table) in enumerate(runs.items()):
            share = 100 * performance_profile(table, thresholds)
            look = line_style(order.index(label)) if looks is None else looks[label]
            every = (7 * k % MARKER_DISTANCE, MARKER_DISTANCE)  # beside those of other labels
            axes.plot(thresholds, share, lw=1.7, ms=5, markevery=every, label=label, **look)
        axes.set(xlabel="score τ (0 no skill, 100 expert)", ylabel="runs with a score above τ (%)")
        axes.set_ylim(-2, 102)
        axes.margins(x=0)
        draw_grid(axes)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), reverse=True)  # the best on top


def plot_differences(tables: Mapping[str, Double], path: Path) -> None:
    """Draws the mean score of the row minus that of the column; white if it may be 0.

    Args:
        tables: label -> scores [runs, datasets, episodes].
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not tables:
        raise SchemaError("there are no scores to compare, expected at least one label.")
    labels, pairs = list(tables)[::-1], differences(tables)  # the best on top
    n = len(labels)
    size = 0.56 * n
    limit = max([abs(found.value) for found in pairs.values()], default=0.0) or 1.0
    with figure(path, width=max(3.6, 2.2 + size), height=1.6 + 0.8 * size) as drawing:
        axes = drawing.add_subplot()
        shown = np.zeros((n, n))
        for (one, other), found in pairs.items():
            row, column = labels.index(one), labels.index(other)
            is_decided = found.low > 0.0 or found.high < 0.0
            shown[row, column] = found.value if is_decided else 0.0
            axes.text(
                column,
                row,
                f"{found.value:+.0f}".replace("-", "−"),
                ha="center",
                va="center",
                fontsize=9,
                fontweight="bold" if is_decided else "normal",
                color="white" if is_decided and abs(found.value) > 0.6 * limit else INK,
            )
        axes.imshow(shown, cmap="PuOr", vmin=-limit, vmax=limit, aspect="auto")
        axes.set_xticks(range(n), labels, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(n), labels)
        axes.set_title("score of row minus column", loc="left")
        for side in axes.spines.values():
            side.set_visible(False)
        axes.tick_params(length=0)


def plot_pareto(
    cases: Collection[Case],
    path: Path,
    looks: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Draws return against collisions, a panel per case; a line joins the Pareto-optimal labels.

    Args:
        cases: of tasks of this library.
        path: where to save; the suffix is the format.
        looks: color and marker of each label; None: by name.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    if not cases:
        raise SchemaError("there are no cases to draw, expected at least one.")
    trained = {label for case in cases for label in case.trained}
    labels = list(dict.fromkeys(label for case in cases for label in case.runs))
    known = looks_of(trained, labels) if looks is None else looks
    looks, columns = {label: known[label] for label in labels}, min(3, len(cases))
    rows = math.ceil(len(cases) / columns)
    with figure(path, width=2.2 + 3.1 * columns, height=0.5 + 2.8 * rows) as drawing:
        grid = drawing.subplots(rows, columns, squeeze=False).ravel()
        for axes, case in zip(grid, cases, strict=False):
            _draw_front(axes, case, looks)
        for axes in grid[len(cases) :]:
            axes.set_visible(False)
        drawing.supxlabel("collisions per episode", fontsize=10)
        drawing.supylabel("team return", fontsize=10)
        handles = [_legend_handle(grid[0], look, label) for label, look in looks.items()]
        if any(case.data is not None for case in cases):
            handles.append(_legend_handle(grid[0], DATA_LINE, "mean of the data"))
        drawing.legend(handles=handles, loc="outside right center", handletextpad=0.4)


def _draw_front(axes: Any, case: Case, looks: Mapping[str, Mapping[str, Any]]) -> None:
    points = pareto(case)
    front = sorted((p.collisions.value, p.team_return.value) for p in points if p.is_best)
    axes.step(*zip(*front, strict=True), where="post", color=GRAY, lw=1, zorder=1)
    for point in points:
        _draw_point(axes, point, looks[point.label])
    if case.data is not None:
        axes.axhline(case.data.mean_return, **DATA_LINE, zorder=0)
    axes.set_title(without_version(case.name), loc="left", fontweight="bold")
    draw_grid(axes, width=0.6)
    _zoom_to_trained(axes, case, points)


def _zoom_to_trained(axes: Any, case: Case, points: Sequence[Point]) -> None:
    """Limits the axes to labels that learned from data; lists labels far outside in text."""
    returns = [p.team_return.value for p in points if p.label in case.trained]
    if not returns:
        return
    returns += [] if case.data is None else [case.data.mean_return]
    span = max(max(returns) - min(returns), 1e-9)
    low = min(returns) - MAX_DISTANCE_IN_VIEW * span
    high = max(returns) + MAX_DISTANCE_IN_VIEW * span
    inside = [p for p in points if low <= p.team_return.value <= high]
    far = [p for p in points if p not in inside]
    if not far:
        return
    ends = [end for p in inside for end in (p.team_return.low, p.team_return.high)]
    ends += returns
    margin = 0.08 * (max(ends) - min(ends))
    axes.set_ylim(min(ends) - margin - 0.1 * (1 + len(far)) * span, max(ends) + margin)
    most = max(p.collisions.high for p in inside)
    axes.set_xlim(-0.04 * most, 1.04 * most)
    listed = "\n".join(
        ["not in view (return at collisions)"]
        + [f"{p.label}: {p.team_return.value:.1f} at {p.collisions.value:.1f}" for p in far]
    ).replace("-", "−")
    axes.text(0.98, 0.03, listed, transform=axes.transAxes, ha="right", fontsize=7.5, color=GRAY)


def _draw_point(axes: Any, point: Point, look: Mapping[str, Any]) -> None:
    """Draws a label with its intervals; filled if it is Pareto-optimal."""
    x, y = point.collisions, point.team_return
    axes.plot([x.low, x.high], [y.value] * 2, color=look["color"], alpha=0.5, lw=1.4)
    axes.plot([x.value] * 2, [y.low, y.high], color=look["color"], alpha=0.5, lw=1.4)
    face = look["color"] if point.is_best else "white"
    axes.plot([x.value], [y.value], **look, ms=6, mfc=face, ls="none")


def plot_estimates(panels: Mapping[str, Mapping[str, Estimate]], path: Path) -> None:
    """Draws estimates as points with intervals: one panel per quantity, one row per policy.

    Args:
        panels: axis label with unit -> policy -> estimate in that unit, as `Table.panels` returns
            it; all panels have the same policies, the first one on top.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there is nothing to draw, panels differ in policies, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    rows = [list(estimates) for estimates in panels.values()]
    if not rows or not rows[0] or any(labels != rows[0] for labels in rows):
        raise SchemaError(
            f"panels {list(panels)} have the rows {rows}, expected at least one panel and row, and "
            "the same rows in every panel."
        )
    labels = rows[0]
    with figure(path, width=1.6 + 2.5 * len(panels), height=0.9 + 0.34 * len(labels)) as drawing:
        axes = drawing.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for panel, (xlabel, estimates) in zip(axes, panels.items(), strict=True):
            _draw_estimates(panel, list(estimates.values()))
            panel.set_xlabel(xlabel)
        axes[0].set_yticks(range(len(labels)), labels)
        axes[0].set_ylim(len(labels) - 0.5, -0.5)  # first row on top


def _draw_estimates(panel: Any, estimates: Sequence[Estimate]) -> None:
    for y, (value, low, high) in enumerate(estimates):
        panel.plot([low, high], [y, y], color=COLORS[0], alpha=0.45, lw=4, solid_capstyle="butt")
        face = "white" if math.isnan(low) else COLORS[0]  # no interval: not a measured policy
        panel.plot([value], [y], "o", color=COLORS[0], mfc=face, ms=5)
    draw_grid(panel, "x")
    panel.margins(x=0.08)
    panel.spines["left"].set_visible(False)
    panel.tick_params(axis="y", length=0)
