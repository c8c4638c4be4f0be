"""Scoreboard: one quantity by dataset and algorithm, its estimates, rankings and matrix."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from swarmdata.drawing.style import family_colors
from swarmdata.evaluation.figures.dot_plot import MAX_PANELS_IN_A_LINE
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import (
    QUANTITIES,
    RETURN,
    SCORE,
    Quantity,
    estimate_values,
    quantities_of,
)
from swarmdata.rollouts.score_intervals import difference_interval
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version
from swarmdata.types import Double


@dataclass(frozen=True, eq=False)
class Scoreboard:
    """One quantity of every algorithm on every dataset; larger is better."""

    column: Column  # the format of its numbers
    values: Mapping[str, Mapping[str, Double]]
    """Dataset -> label, in the study's order -> [runs, episodes], the same episodes for all."""
    data: Mapping[str, float]  # dataset -> mean of its own episodes, where it is known
    families: Mapping[str, str]  # label -> family, in the study's order

    @cached_property
    def estimates(self) -> dict[str, dict[str, Estimate]]:
        """Dataset -> label -> mean with its interval, in stored units."""
        return {
            dataset: {label: estimate_values(each, self.column) for label, each in found.items()}
            for dataset, found in self.values.items()
        }

    @property
    def shown_data(self) -> dict[str, float]:
        """Dataset, without version -> mean of its own episodes in the units of figures."""
        return {without_version(name): self.column.factor * v for name, v in self.data.items()}

    def lead(self, dataset: str, label: str, other: str) -> Estimate:
        """Mean of a label minus that of another, paired by episode."""
        found = self.values[dataset]
        return difference_interval(found[label], found[other])

    def ranking(self, dataset: str) -> list[str]:
        """The labels on a dataset, the best first."""
        found = self.estimates[dataset]
        return sorted(found, key=lambda label: -found[label].value)

    def best_by_family(self, dataset: str) -> dict[str, str]:
        """The best label of each family on a dataset, the best family first."""
        best: dict[str, str] = {}
        for label in self.ranking(dataset):
            best.setdefault(self.families[label], label)
        return best

    def leaders(self, dataset: str) -> list[str]:
        """The best label, and those whose paired difference to it is not clearly below 0.

        The best is chosen on the same episodes, so it is a little flattered.
        """
        first, *others = self.ranking(dataset)
        return [first, *(name for name in others if not self.lead(dataset, first, name).low > 0.0)]

    def in_shown_units(self, dataset: str) -> dict[str, Estimate]:
        """The estimates on a dataset in the units of tables and figures."""
        found = self.estimates[dataset]
        return {label: self.column.shown(each) for label, each in found.items()}


def quantity_of(results: ResultSet) -> Quantity:
    """The score; or the return, if a world of the study has no measured references."""
    is_scored = all(case.reference is not None for case in results.cases)
    return SCORE if is_scored else RETURN


def make_scoreboard(results: ResultSet, families: Mapping[str, str], key: str) -> Scoreboard:
    """Makes the scoreboard of a key of `QUANTITIES`; families are in the order of the tables."""
    quantity = QUANTITIES[key]
    cases = [case for case in results.cases if quantity in quantities_of(case)]
    values = {
        case.name: {
            label: found
            for label in families
            if label in case.runs and not np.isnan(found := quantity.values(case, label)).any()
        }
        for case in cases
    }
    known = {case.name: quantity.data(case) for case in cases}
    data = {name: value for name, value in known.items() if value is not None}
    return Scoreboard(quantity.column, values, data, families)


LEAST_COVERAGE = 1 / 2  # of the datasets of a study, on which a row has to be to get a column

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


def plot_beside_data(board: Scoreboard, path: Path) -> None:
    """Draws a quantity of all rows on all datasets, colored by the difference to the data."""
    means = {
        name: dict.fromkeys(each, board.shown_data[without_version(name)])
        for name, each in board.estimates.items()
    }
    scale = f"{board.column.label} minus the mean of the data"
    plot_board(board, path, means, scale, has_side=True)


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
