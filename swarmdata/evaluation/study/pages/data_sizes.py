"""Data efficiency: the same algorithms on smaller parts of the same data."""

from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_data_efficiency_cell
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.pages.study_figures import plot_sizes
from swarmdata.rollouts.score_statistics import Estimate

Parts = dict[str, list[DatasetFacts]]
"""Dataset -> the facts of its measured sizes, the smallest first, of two or more."""


def size_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title, with a figure in a folder; empty if nothing of it was measured."""
    if found.sizes is None or found.study.sizes is None:
        return {}
    families = {label: found.family(label) for label in found.study.sizes.algorithms}
    board = make_scoreboard(found.sizes, families, quantity_of(found.sizes).column.key)
    sizes = {short_name(each): _sizes_of(each, found) for each in found.study.sizes.datasets}
    parts = {dataset: facts for dataset, facts in sizes.items() if len(facts) > 1}
    if not parts:
        return {}
    _plot(board, parts, found, out / "sizes.png")
    caption = f"{board.column.label.capitalize()}; the dashed line is the mean of those episodes."
    return {"Data efficiency": f"{_table(board, parts)}\n{caption}\n\n![by joint steps](sizes.png)"}


def _sizes_of(dataset: str, found: Findings) -> list[DatasetFacts]:
    """The facts of all sizes of a dataset that were measured, the smallest first."""
    assert found.study.sizes is not None
    assert found.sizes is not None
    wanted = [dataset_of_size(dataset, size) for size in found.study.sizes.sizes]
    facts = {
        found.facts[cell.name].id: found.facts[cell.name]
        for cell in found.cells
        if is_data_efficiency_cell(found.study, cell) and (cell.source, cell.n_steps) in wanted
    }
    measured = [each for each in facts.values() if each.id in found.sizes.datasets]
    return sorted(measured, key=lambda each: each.figures.n_steps)


def _plot(board: Scoreboard, parts: Parts, found: Findings, path: Path) -> None:
    panels: dict[str, dict[str, dict[int, Estimate]]] = {}
    data: dict[str, dict[int, float]] = {}
    for dataset, sizes in parts.items():
        lines = panels.setdefault(dataset, {})
        for facts in sizes:
            for label, each in board.in_shown_units(facts.id).items():
                lines.setdefault(label, {})[facts.figures.n_steps] = each
            if facts.id in board.data:
                mean = board.column.factor * board.data[facts.id]
                data.setdefault(dataset, {})[facts.figures.n_steps] = mean
    plot_sizes(panels, data, found.looks, path, ylabel=board.column.label)


def _table(board: Scoreboard, parts: Parts) -> str:
    """A row for each dataset and algorithm, with the estimates of all sizes of that dataset."""
    rows = []
    for dataset, sizes in parts.items():
        for label in dict.fromkeys(label for each in sizes for label in board.estimates[each.id]):
            cells = [
                f"{each.figures.n_steps:,}: "
                f"{format_estimate(board.estimates[each.id][label], board.column)}"
                for each in sizes
                if label in board.estimates[each.id]
            ]
            rows.append((dataset, f"`{label}`", "; ".join(cells)))
    return markdown.table(("dataset", "algorithm", f"joint steps: {board.column.label}"), rows)
