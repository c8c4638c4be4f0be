"""Figures of a result set: scores by dataset, performance profiles, who beats whom, Pareto view.

A label has one color and marker, by its place in the order it is given in.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.aggregate import improvements, mean_over_runs, pareto, profile_band, thresholds_of
from swarmdata.errors import SchemaError
from swarmdata.figures import COLORS, FAINT, GRAY, INK, figure
from swarmdata.results import Case, ResultSet
from swarmdata.types import Double

MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))
"""Labels beyond the colors differ in these."""


def looks_of(labels: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Color and marker of each label: colors first, then markers change."""
    return {
        label: {
            "color": COLORS[k % len(COLORS)],
            "marker": MARKERS[(k // len(COLORS)) % len(MARKERS)],
        }
        for k, label in enumerate(labels)
    }


def plot_scores(results: ResultSet, path: Path) -> None:
    """Draws the score of every label on every dataset with its interval, and the data's mean.

    Args:
        results: what was measured; datasets without a score are left out.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: no dataset has a score, or an unknown suffix.
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
                    found = mean_over_runs(case.scores(label))
                    axes.plot([x, x], [found.low, found.high], color=looks[label]["color"], lw=1.6)
                    axes.plot([x], [found.value], **looks[label], ms=5, ls="none")
        _name_datasets(axes, [case.name for case in cases])
        axes.set_ylabel("score (0 no skill, 100 expert)")
        axes.grid(axis="y", color=FAINT, lw=0.6)
        axes.set_axisbelow(True)
        _legend(axes, looks, extra=any(case.data_score is not None for case in cases))


def _draw_data(axes: Any, case: Case, place: int, span: float) -> None:
    """The mean of the dataset's own episodes as a line across its labels."""
    if case.data_score is not None:
        ends = [place - span / 2, place + span / 2]
        axes.plot(ends, [case.data_score] * 2, color=INK, lw=1.1, ls=(0, (4, 2)), zorder=1)


def _name_datasets(axes: Any, names: Sequence[str]) -> None:
    """Ids below their places; long ones on two lines, without the version zero of all."""
    short = [name.replace("-mini", "\nmini").replace("-v0", "") for name in names]
    axes.set_xticks(range(len(names)), [name.replace("-", "\n", 1) for name in short], fontsize=9)
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.tick_params(axis="x", length=0)


def _legend(axes: Any, looks: Mapping[str, Mapping[str, Any]], *, extra: bool) -> None:
    handles = [
        axes.plot([], [], **look, ms=5, ls="none", label=label)[0] for label, look in looks.items()
    ]
    if extra:
        handles += axes.plot([], [], color=INK, lw=1.1, ls=(0, (4, 2)), label="the data's mean")
    axes.legend(
        handles=handles,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=min(5, len(handles)),
        handletextpad=0.4,
        columnspacing=1.2,
    )


def plot_profiles(tables: Mapping[str, Double], path: Path) -> None:
    """Draws the share of runs that score above each threshold, with 95 % bands.

    Args:
        tables: label -> scores [runs, datasets], such as `aggregate.complete(results).tables`.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: nothing to draw, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    thresholds = thresholds_of(tables)
    with figure(path, width=6.4, height=3.9) as drawing:
        axes = drawing.add_subplot()
        for k, (label, table) in enumerate(tables.items()):
            band = profile_band(table, thresholds)
            color = COLORS[k % len(COLORS)]
            dash = DASHES[(k // len(COLORS)) % len(DASHES)]
            axes.plot(thresholds, 100 * band.value, color=color, ls=dash, lw=1.7, label=label)
            axes.fill_between(
                thresholds, 100 * band.low, 100 * band.high, color=color, alpha=0.12, lw=0
            )
        axes.set(xlabel="score τ (0 no skill, 100 expert)", ylabel="runs with a score above τ (%)")
        axes.set_ylim(-2, 102)
        axes.margins(x=0)
        axes.grid(color=FAINT, lw=0.8)
        axes.set_axisbelow(True)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def plot_improvements(tables: Mapping[str, Double], path: Path) -> None:
    """Draws the probability that a row's run beats a column's; white is undecided at 95 %.

    Args:
        tables: label -> scores [runs, datasets].
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: nothing to draw, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    if not tables:
        raise SchemaError("there are no scores to compare, expected at least one label.")
    labels, pairs = list(tables)[::-1], improvements(tables)  # the best on top
    n = len(labels)
    size = 0.56 * n
    with figure(path, width=2.2 + size, height=1.6 + 0.8 * size) as drawing:
        axes = drawing.add_subplot()
        shown = np.full((n, n), 0.5)
        for (one, other), found in pairs.items():
            row, column = labels.index(one), labels.index(other)
            is_decided = found.low > 0.5 or found.high < 0.5
            shown[row, column] = found.value if is_decided else 0.5
            axes.text(
                column,
                row,
                f"{100 * found.value:.0f}",
                ha="center",
                va="center",
                fontsize=9,
                fontweight="bold" if is_decided else "normal",
                color="white" if is_decided and abs(found.value - 0.5) > 0.3 else INK,
            )
        axes.imshow(shown, cmap="PuOr", vmin=0, vmax=1, aspect="auto")
        axes.set_xticks(range(n), labels, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(n), labels)
        axes.set_title("probability (%) that the row beats the column", loc="left")
        for side in axes.spines.values():
            side.set_visible(False)
        axes.tick_params(length=0)


def plot_pareto(cases: Collection[Case], path: Path) -> None:
    """Draws return against collisions, a panel per case; a line joins what no other beats.

    Args:
        cases: datasets or specs of tasks of this library.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: nothing to draw, or an unknown suffix.
        MissingExtraError: matplotlib is not installed.
    """
    if not cases:
        raise SchemaError("there are no cases to draw, expected at least one.")
    points = {case: pareto(case) for case in cases}
    labels = list(dict.fromkeys(label for case in cases for label in case.runs))
    looks, columns = looks_of(labels), min(3, len(cases))
    rows = math.ceil(len(cases) / columns)
    with figure(path, width=0.6 + 3.1 * columns + 1.6, height=0.5 + 2.7 * rows) as drawing:
        grid = drawing.subplots(rows, columns, squeeze=False).ravel()
        for axes, case in zip(grid, cases, strict=False):
            front = sorted(
                (p.collisions.value, p.team_return.value) for p in points[case] if p.is_best
            )
            axes.step(*zip(*front, strict=True), where="post", color=GRAY, lw=1, zorder=1)
            for point in points[case]:
                _draw_point(axes, point, looks[point.label])
            if case.data is not None:
                axes.axhline(case.data.mean_return, color=INK, lw=0.9, ls=(0, (4, 2)), zorder=0)
            axes.set_title(case.name.removesuffix("-v0"), loc="left", fontweight="bold")
            axes.grid(color=FAINT, lw=0.6)
            axes.set_axisbelow(True)
        for axes in grid[len(cases) :]:
            axes.set_visible(False)
        drawing.supxlabel("collisions per episode", fontsize=10)
        drawing.supylabel("team return", fontsize=10)
        handles = [
            grid[0].plot([], [], **look, ms=5, ls="none", label=k)[0] for k, look in looks.items()
        ]
        drawing.legend(handles=handles, loc="outside right center", handletextpad=0.4)


def _draw_point(axes: Any, point: Any, look: Mapping[str, Any]) -> None:
    x, y = point.collisions, point.team_return
    axes.plot([x.low, x.high], [y.value] * 2, color=look["color"], alpha=0.5, lw=1.4)
    axes.plot([x.value] * 2, [y.low, y.high], color=look["color"], alpha=0.5, lw=1.4)
    face = look["color"] if point.is_best else "white"
    axes.plot([x.value], [y.value], **look, ms=6, mfc=face, ls="none")
