"""The figure of the differences that a study asks for, no higher than a screen."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.drawing.style import words_of_pair
from swarmdata.evaluation.figures.dot_plot import (
    HOLLOW_LOOK,
    MAX_PANELS_IN_A_LINE,
    Panel,
    PanelLine,
    plot_dots,
)
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.study.pages.row_differences import RowDifference, verdict_of
from swarmdata.rollouts.score_statistics import Estimate

CHANGE_LIMIT = 60.0
"""Points of score at which colors end."""

Found = Mapping[str, Mapping[str, Estimate]]
"""Panel -> row -> difference, in shown units; NaN is left out."""


def plot_row_differences(
    differences: Sequence[RowDifference], columns: Sequence[Column], path: Path
) -> None:
    """Draws differences beside 0.

    Of one pair, or on one dataset, every quantity is a panel. Several pairs on a few datasets have
    a panel for each dataset, with the first quantity; on many datasets they are a matrix.

    Args:
        differences: at least one.
        columns: the quantities, the main one first.
        path: where to save.
    """
    main, pairs = columns[0], list(dict.fromkeys(map(_pair, differences)))
    datasets = list(dict.fromkeys(each.dataset for each in differences))
    if len(datasets) == 1 or len(pairs) == 1:
        by_pair = len(datasets) == 1
        title = datasets[0] if by_pair else pairs[0]
        found = {
            f"change of {column.header}": {
                _pair(each) if by_pair else each.dataset: _shown(each, column)
                for each in differences
            }
            for column in columns
        }
        _plot(found, [title], list(found), path)
    elif len(datasets) <= MAX_PANELS_IN_A_LINE:
        found = {
            name: {_pair(each): _shown(each, main) for each in differences if each.dataset == name}
            for name in datasets
        }
        _plot(found, datasets, [f"change of {main.header}"] * len(datasets), path)
    else:
        cells = {
            (each.dataset, _pair(each)): MatrixCell(value, value, verdict_of(difference) != UNCLEAR)
            for each in differences
            if not math.isnan(value := (difference := _shown(each, main)).value)
        }
        rows: dict[str, list[str]] = {}
        for name in sorted(datasets):
            rows.setdefault(name.partition("-")[0], []).append(name)
        notes = Notes(
            CHANGE_LIMIT, f"change of {main.label}, paired by episode",
            "framed: clearly not 0; dot: not run",
        )  # fmt: skip
        values = {pair: [cell.value for (_, each), cell in cells.items() if each == pair]
                  for pair in pairs}  # fmt: skip
        order = sorted(pairs, key=lambda pair: (-len(values[pair]), -sum(values[pair])))
        plot_matrix(cells, rows, {"": order}, path, notes)


UNCLEAR = "no clear change"


def _pair(each: RowDifference) -> str:
    return words_of_pair(each.one, each.other)


def _shown(each: RowDifference, column: Column) -> Estimate:
    return Estimate(*(column.factor * end for end in each.estimates[column.key]))


def _plot(found: Found, titles: Sequence[str], labels: Sequence[str], path: Path) -> None:
    """Draws a line of panels, rows sorted by the first; hollow markers may be 0."""
    rows = list(dict.fromkeys(row for each in found.values() for row in each))
    first = next(iter(found.values()))
    rows.sort(key=lambda row: -first[row].value if row in first else math.inf)
    panels = []
    for k, (label, each) in enumerate(zip(labels, found.values(), strict=True)):
        known = {row: change for row, change in each.items() if not math.isnan(change.value)}
        unclear = [row for row, change in known.items() if verdict_of(change) == UNCLEAR]
        title = titles[k] if k < len(titles) else ""
        panels.append(Panel(known, label, title, scale=label, hollow=unclear))
    plot_dots([PanelLine(rows, panels)], {}, path, legend={UNCLEAR: HOLLOW_LOOK}, zero=True)
