"""The matrices of a study: more datasets and rows than dot plots have room for on a screen."""

from collections.abc import Mapping
from pathlib import Path

from swarmdata.drawing.style import family_colors
from swarmdata.evaluation.figures.dot_plot import MAX_PANELS_IN_A_LINE
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.specs.plain_names import without_version

LEAST_COVERAGE = 1 / 3  # of the datasets of a study, on which a row has to be to get a column

FRAMES = "framed: the best of a dataset and those not clearly worse (paired); dot: not run"


SCALE_LIMIT = 60.0  # points of score or percentage points at which colors end


def plot_board(
    board: Scoreboard,
    path: Path,
    base: Mapping[str, Mapping[str, float]],
    scale: str,
    *,
    has_side: bool = False,
) -> None:
    """Draws a quantity of all rows on all datasets, colored by the difference to `base`.

    Rows of the matrix are the datasets by task, perhaps with the mean of the data beside them; of
    few datasets, the rows of the study. `scale` says what the color shows.
    """
    datasets = _datasets(board)
    is_wide = len(board.estimates) > MAX_PANELS_IN_A_LINE
    labels = _labels(board, LEAST_COVERAGE * len(board.estimates) if is_wide else 1)
    cells = {
        (without_version(dataset), label): MatrixCell(
            each.value, each.value - base[dataset][label], label in board.leaders(dataset)
        )
        for dataset in board.estimates
        for label, each in board.in_shown_units(dataset).items()
    }
    notes = Notes(SCALE_LIMIT, scale, FRAMES, family_colors(tuple(labels)))
    if is_wide:
        if has_side:
            notes = notes._replace(side=board.shown_data, side_title="data")
        plot_matrix(cells, datasets, labels, path, notes)
    else:
        turned = {(label, dataset): cell for (dataset, label), cell in cells.items()}
        columns = {"": [name for names in datasets.values() for name in names]}
        plot_matrix(turned, labels, columns, path, notes)


def _datasets(board: Scoreboard) -> dict[str, list[str]]:
    """Names without versions by task, those with the worst data first."""
    groups: dict[str, list[str]] = {}
    for name in sorted(board.estimates, key=lambda name: (board.data.get(name, 0.0), name)):
        groups.setdefault(name.partition("-")[0], []).append(without_version(name))
    return dict(sorted(groups.items()))


def _labels(board: Scoreboard, least: float) -> dict[str, list[str]]:
    """Rows on at least so many datasets by family, those on most datasets and the best first."""
    where = {
        label: [dataset for dataset, found in board.estimates.items() if label in found]
        for label in board.families
    }
    shown = [label for label, datasets in where.items() if len(datasets) >= least]
    shared = [d for d, found in board.estimates.items() if found.keys() >= {*shown}]

    def rank(label: str) -> tuple[int, float]:
        values = [board.estimates[dataset][label].value for dataset in shared or where[label]]
        return -len(where[label]), -sum(values) / len(values)

    groups: dict[str, list[str]] = {}
    for label in shown:
        groups.setdefault(board.families[label], []).append(label)
    return {family: sorted(labels, key=rank) for family, labels in groups.items()}
