"""Figures of a result set: scores, performance profiles, comparisons, Pareto fronts, estimates.

A label has the same color and marker in all of them.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.drawing.style import (
    COLORS,
    COLUMN_WIDTH,
    GRAY,
    INK,
    PAGE_WIDTH,
    draw_grid,
    draw_legend,
    family_looks,
    figure,
    line_looks,
    words_of,
)
from swarmdata.errors import SchemaError
from swarmdata.evaluation.figures.dot_plot import (
    LETTER_WIDTH,
    Looks,
    Panel,
    PanelLine,
    plot_by_dataset,
    plot_dots,
)
from swarmdata.evaluation.figures.front_plot import FrontPanel, plot_fronts
from swarmdata.evaluation.results.aggregates import (
    Point,
    differences,
    pareto_front,
    performance_profile,
    returns_and_collisions,
    thresholds_of,
)
from swarmdata.evaluation.results.result_set import Case, ResultSet
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version
from swarmdata.types import Double

MATRIX_CELL = 0.36, 0.2
"""Inches: width and height."""

MAX_DISTANCE_IN_VIEW = 0.6
"""Of a return from those that learned from data, as a share of their range."""

BASELINE_MARKERS = ("X", "p", "*", "<", ">", "h", "d")
"""Of labels that learned from no data, which are all gray."""


def looks_of(trained: Mapping[str, str], others: Collection[str] = ()) -> dict[str, dict[str, str]]:
    """Returns the color and marker of each label, by name, so that all figures of a report agree.

    Args:
        trained: label -> algorithm, of labels that learned from data: an algorithm has a color, its
            labels have markers.
        others: labels that did not; all are gray.
    """
    looks = family_looks(dict(sorted(trained.items())))
    for k, label in enumerate(sorted(set(others) - set(trained))):
        looks[label] = {"color": GRAY, "marker": BASELINE_MARKERS[k % len(BASELINE_MARKERS)]}
    return looks


def result_looks(results: ResultSet) -> dict[str, dict[str, str]]:
    """The looks of all labels of a result set, baselines included."""
    return _looks_in([*results.cases, *results.baselines])


def _looks_in(cases: Collection[Case]) -> dict[str, dict[str, str]]:
    trained = {
        label: case.runs[label][0].provenance.algorithm or label
        for case in cases
        for label in case.trained
    }
    return looks_of(trained, {label for case in cases for label in case.runs})


def plot_result_scores(results: ResultSet, path: Path) -> None:
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
    found = {
        without_version(case.name): {
            label: mean_interval(case.scores(label))
            for label in results.labels
            if label in case.runs
        }
        for case in cases
    }
    data = {
        without_version(case.name): case.data_score for case in cases if case.data_score is not None
    }
    label = "score (0 no skill, 100 expert)"
    plot_by_dataset(found, data, result_looks(results), path, label=label)


def plot_score_profiles(tables: Mapping[str, Double], looks: Looks, path: Path) -> None:
    """Draws the share of the measured runs that score above each threshold, the best on top.

    Args:
        tables: label -> scores [runs, datasets, episodes], such as `ComparableScores.tables`.
        looks: color and marker of each label.
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    runs = {label: table.mean(axis=-1) for label, table in tables.items()}
    thresholds = thresholds_of(runs)
    order = sorted(runs, key=lambda label: (-float(runs[label].mean()), label))
    drawn = line_looks({label: looks[label] for label in order})
    with figure(path, width=COLUMN_WIDTH, height=2.45) as drawing:
        axes = drawing.add_subplot()
        for label in order:
            share = 100 * performance_profile(runs[label], thresholds)
            axes.plot(
                thresholds, share, lw=1.4, ds="steps-mid", label=words_of(label), **drawn[label]
            )
        axes.set(xlabel="score τ (0 no skill, 100 expert)", ylabel="runs with a score above τ (%)")
        axes.set_ylim(-2, 102)
        axes.margins(x=0)
        draw_grid(axes, width=0.5)
        draw_legend(drawing, axes.get_lines())


def plot_differences(tables: Mapping[str, Double], path: Path) -> None:
    """Draws the mean score of each label (a row) minus that of each worse one (a column).

    Args:
        tables: label -> scores [runs, datasets, episodes].
        path: where to save; the suffix is the format.

    Raises:
        SchemaError: there are fewer than two labels, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    labels = sorted(tables, key=lambda label: (-float(tables[label].mean()), label))
    if len(labels) < 2:
        raise SchemaError(f"got the labels {labels} to compare, expected at least two.")
    pairs = differences(tables)
    rows, columns = labels[:-1], labels[1:]
    n, room = len(rows), LETTER_WIDTH * max(map(len, labels))
    limit = max(abs(found.value) for found in pairs.values()) or 1.0
    width = min(PAGE_WIDTH, max(COLUMN_WIDTH, 1.0 + room + MATRIX_CELL[0] * n))
    font = min(7.0, 17.0 * (width - 1.9 - room) / n)  # four characters fill a column
    with figure(path, width=width, height=0.6 + 0.7 * room + MATRIX_CELL[1] * max(n, 3)) as drawing:
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
                    fontsize=font,
                    fontweight="bold" if is_decided else "normal",
                    color="white" if is_decided and abs(found.value) > 0.45 * limit else INK,
                )
        image = axes.imshow(shown, cmap="PuOr", vmin=-limit, vmax=limit, aspect="auto")
        drawing.colorbar(image, ax=axes, label="score of row − column", aspect=12)
        names = [words_of(label) for label in columns]
        axes.set_xticks(range(n), names, rotation=45, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(n), [words_of(label) for label in rows])
        axes.set(xlabel="worse", ylabel="better")
        axes.set_title("bold: clearly not 0", loc="left", fontsize=7.5)
        for side in axes.spines.values():
            side.set_visible(False)
        axes.tick_params(length=0)


def plot_pareto(cases: Collection[Case], path: Path, looks: Looks | None = None) -> None:
    """Draws return against collisions, a panel per case; a line joins the Pareto-optimal labels.

    Args:
        cases: of tasks of this library.
        path: where to save; the suffix is the format.
        looks: color and marker of each label; None: by algorithm.

    Raises:
        SchemaError: there is nothing to draw, or the suffix is unknown.
        MissingExtraError: matplotlib is not installed.
    """
    panels = {without_version(case.name): _front_of(case) for case in cases}
    known = _looks_in(cases) if looks is None else looks
    plot_fronts(panels, known, path, xlabel="collisions per episode", ylabel="team return")


def _front_of(case: Case) -> FrontPanel:
    points = returns_and_collisions(case)
    far = _far_from_trained(case, points)
    near = [point for point in points if point.label not in far]
    best = pareto_front(  # an expert that is not in view is no reason to call all others worse
        [point.team_return.value for point in near], [point.collisions.value for point in near]
    )
    return FrontPanel(
        points={point.label: (point.collisions, point.team_return) for point in points},
        front=[point.label for point, is_best in zip(near, best.tolist(), strict=True) if is_best],
        line=None if case.data is None else case.data.mean_return,
        far=far,
    )


def _far_from_trained(case: Case, points: Sequence[Point]) -> list[str]:
    """Labels whose return is far outside those of labels that learned from data."""
    returns = [p.team_return.value for p in points if p.label in case.trained]
    if not returns:
        return []
    returns += [] if case.data is None else [case.data.mean_return]
    margin = MAX_DISTANCE_IN_VIEW * max(max(returns) - min(returns), 1e-9)
    low, high = min(returns) - margin, max(returns) + margin
    return [p.label for p in points if not low <= p.team_return.value <= high]


def plot_estimates(
    panels: Mapping[str, Mapping[str, Estimate]], path: Path, looks: Looks | None = None
) -> None:
    """Draws estimates as points with intervals: one panel per quantity, one row per policy.

    Args:
        panels: axis label with unit -> policy -> estimate in that unit, as `Table.panels` returns
            it; all panels have the same policies, the first one on top.
        path: where to save; the suffix is the format.
        looks: color and marker of each policy; None: all alike.

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
    plain: dict[str, Any] = {"color": COLORS[0], "marker": "o"}
    shown = dict.fromkeys(rows[0], plain) if looks is None else looks
    drawn = [Panel(estimates, xlabel) for xlabel, estimates in panels.items()]
    plot_dots([PanelLine(rows[0], drawn)], shown, path, legend={})
