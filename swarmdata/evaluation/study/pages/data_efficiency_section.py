"""The section on data efficiency: the same algorithms on smaller parts of the same data."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_data_efficiency_cell
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.pages.study_figures import plot_sizes
from swarmdata.rollouts.score_statistics import Estimate

EstimatesBySize = dict[str, dict[int, Estimate]]
"""Label -> joint steps -> estimate."""


def size_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title; empty if nothing of it was measured.

    Args:
        found: what was measured.
        out: folder for the figure.
    """
    if found.sizes is None or found.study.sizes is None:
        return {}
    sizes = found.study.sizes
    families = {label: found.family(label) for label in sizes.algorithms}
    key = quantity_of(found.sizes).column.key
    board = make_scoreboard(found.sizes, families, key)
    panels: dict[str, EstimatesBySize] = {}
    data: dict[str, dict[int, float]] = {}
    for dataset in sizes.datasets:
        for facts in _facts_of(dataset, found):
            name, n_steps = facts.id, facts.figures.n_steps
            for label, each in (
                board.in_shown_units(name).items() if name in board.estimates else ()
            ):
                panels.setdefault(short_name(dataset), {}).setdefault(label, {})[n_steps] = each
            if name in board.data:
                mean = board.column.factor * board.data[name]
                data.setdefault(short_name(dataset), {})[n_steps] = mean
    if not panels:
        return {}
    plot_sizes(panels, data, found.looks, out / "sizes.png", ylabel=board.column.label)
    caption = f"{board.column.label.capitalize()}; the dashed line is the mean of those episodes."
    figure = "![by joint steps](sizes.png)"
    return {"Data efficiency": f"{_size_table(panels, board)}\n{caption}\n\n{figure}\n"}


def _facts_of(dataset: str, found: Findings) -> list[DatasetFacts]:
    """The facts of all sizes of a dataset, the smallest first."""
    assert found.study.sizes is not None
    wanted = [dataset_of_size(dataset, size) for size in found.study.sizes.sizes]
    facts = {
        found.facts[cell.name].id: found.facts[cell.name]
        for cell in found.cells
        if is_data_efficiency_cell(found.study, cell) and (cell.source, cell.n_steps) in wanted
    }
    return sorted(facts.values(), key=lambda each: each.figures.n_steps)


def _size_table(panels: Mapping[str, EstimatesBySize], board: Scoreboard) -> str:
    """A row for each dataset and algorithm, a column for each size of that dataset."""
    column = replace(board.column, factor=1.0)  # the numbers have shown units already
    rows = []
    for dataset, lines in panels.items():
        for label, points in lines.items():
            cells = [f"{n:,}: {format_estimate(points[n], column)}" for n in sorted(points)]
            rows.append((dataset, f"`{label}`", "; ".join(cells)))
    return markdown.table(("dataset", "algorithm", f"joint steps: {board.column.label}"), rows)
