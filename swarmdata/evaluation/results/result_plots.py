"""Figures of a result set, in which a label has the same color and marker everywhere."""

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from swarmdata.drawing.style import (
    COLUMN_WIDTH,
    GRAY,
    draw_grid,
    draw_legend,
    family_looks,
    figure,
    line_looks,
    words_of,
)
from swarmdata.evaluation.figures.dot_plot import (
    Looks,
    Panel,
    PanelLine,
    plot_by_dataset,
    plot_dots,
)
from swarmdata.evaluation.figures.front_plot import FrontPanel, plot_fronts
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.aggregates import (
    collisions_and_returns,
    differences,
    pareto_front,
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

FAR_OUT = 3.0
"""Interquartile ranges beyond the quartiles: the outer fence of Tukey (1977, section 2D)."""

BASELINE_MARKERS = ("X", "p", "*", "<", ">", "h", "d")
"""Of labels that learned from no data, which are all gray."""


def looks_of(trained: Mapping[str, str], others: Collection[str] = ()) -> dict[str, dict[str, str]]:
    """Returns the color and marker of each label, by name, so that all figures of a report agree.

    An algorithm has a color, its labels have markers; those that learned from no data are gray.
    """
    looks = family_looks(dict(sorted(trained.items())))
    for k, label in enumerate(sorted(set(others) - set(trained))):
        looks[label] = {"color": GRAY, "marker": BASELINE_MARKERS[k % len(BASELINE_MARKERS)]}
    return looks


def result_looks(results: ResultSet) -> dict[str, dict[str, str]]:
    """The looks of all labels of a result set, baselines included."""
    cases = (*results.cases, *results.baselines)
    trained = {
        label: case.runs[label][0].provenance.algorithm or label
        for case in cases
        for label in case.trained
    }
    return looks_of(trained, {label for case in cases for label in case.runs})


def plot_result_scores(results: ResultSet, path: Path) -> None:
    """Draws the score of every label on every dataset that has one, and the mean of the data."""
    found, data = {}, {}
    for case in (each for each in results.cases if each.reference is not None):
        name, labels = without_version(case.name), (k for k in results.labels if k in case.runs)
        found[name] = {label: mean_interval(case.scores(label)) for label in labels}
        if case.data_score is not None:
            data[name] = case.data_score
    label = "score (0 no skill, 100 expert)"
    plot_by_dataset(found, data, result_looks(results), path, label=label)


def plot_score_profiles(tables: Mapping[str, Double], looks: Looks, path: Path) -> None:
    """Draws the share of the measured runs that score above each threshold, the best on top.

    The tables are label -> scores [runs, datasets, episodes], such as `ComparableScores.tables`.
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

    The tables are label -> scores [runs, datasets, episodes], of two labels or more.
    """
    labels = sorted(tables, key=lambda label: (-float(tables[label].mean()), label))
    pairs, rows, columns = differences(tables), labels[:-1], labels[1:]
    cells = {}
    for k, one in enumerate(rows):
        for other in columns[k:]:
            found = pairs[one, other]
            is_clear = found.low > 0.0 or found.high < 0.0
            cells[one, other] = MatrixCell(found.value, found.value * is_clear, is_clear)
    limit = max(abs(cell.change) for cell in cells.values()) or 1.0
    notes = Notes(limit, "score of row − column", "the best first; framed: clearly not 0")
    plot_matrix(cells, {"": rows}, {"": columns}, path, notes)


def plot_pareto(cases: Collection[Case], path: Path, looks: Looks) -> None:
    """Draws return against collisions, a panel per case; a line joins the Pareto-optimal labels.

    The cases are of tasks of this library.
    """
    panels = {without_version(case.name): _front_of(case) for case in cases}
    plot_fronts(panels, looks, path, xlabel="collisions per episode", ylabel="team return")


def _front_of(case: Case) -> FrontPanel:
    points = collisions_and_returns(case)
    far = far_from_trained(case, {label: y.value for label, (_, y) in points.items()})
    near = {label: point for label, point in points.items() if label not in far}
    best = pareto_front(  # an expert that is not in view is no reason to call all others worse
        [y.value for _, y in near.values()], [x.value for x, _ in near.values()]
    )
    return FrontPanel(
        points=points,
        front=[label for label, is_best in zip(near, best.tolist(), strict=True) if is_best],
        line=None if case.data is None else case.data.mean_return,
        far=far,
    )


def far_from_trained(case: Case, returns: Mapping[str, float]) -> list[str]:
    """Labels whose return is far outside those of most labels that learned from data."""
    if not case.trained:
        return []
    learned = np.array([returns[label] for label in case.trained])
    first, third = np.quantile(learned, (0.25, 0.75))
    fence = FAR_OUT * (third - first)
    known = [*learned[(learned >= first - fence) & (learned <= third + fence)]]
    known += [] if case.data is None else [case.data.mean_return]
    margin = MAX_DISTANCE_IN_VIEW * max(max(known) - min(known), 1e-9)
    low, high = min(known) - margin, max(known) + margin
    return [label for label, value in returns.items() if not low <= value <= high]


def plot_estimates(panels: Mapping[str, Mapping[str, Estimate]], path: Path, looks: Looks) -> None:
    """Draws the panels of `Table.panels` with a row per policy, the first one on top."""
    rows = next((list(estimates) for estimates in panels.values()), [])
    drawn = [Panel(estimates, xlabel) for xlabel, estimates in panels.items()]
    plot_dots([PanelLine(rows, drawn)], looks, path, legend={})
