"""Data efficiency: the same algorithms on less of the same data."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.cells.study_data import Facts, named, sized
from swarmdata.evaluation.study.pages.collect_results import Findings, is_size
from swarmdata.evaluation.study.pages.scoreboard import Board, board_of, quantity_of
from swarmdata.evaluation.study.pages.study_figures import plot_sizes
from swarmdata.rollouts.score_statistics import Estimate

Lines = dict[str, dict[int, Estimate]]


def size_section(found: Findings, out: Path) -> dict[str, str]:
    """The part of the page, by its title; none where nothing of it was measured.

    Args:
        found: what was measured.
        out: folder for the figure.
    """
    if found.sizes is None or found.study.sizes is None:
        return {}
    sizes = found.study.sizes
    families = {label: found.family(label) for label in sizes.algorithms}
    key = quantity_of(found.sizes).column.key
    board = board_of(found.sizes, families, key)
    panels: dict[str, Lines] = {}
    data: dict[str, dict[int, float]] = {}
    for dataset in sizes.datasets:
        for facts in _facts_of(dataset, found):
            name, n_steps = facts.id, facts.figures.n_steps
            for label, each in board.shown(name).items() if name in board.estimates else ():
                panels.setdefault(named(dataset), {}).setdefault(label, {})[n_steps] = each
            if name in board.data:
                own = board.column.factor * board.data[name]
                data.setdefault(named(dataset), {})[n_steps] = own
    if not panels:
        return {}
    plot_sizes(panels, data, out / "sizes.png", ylabel=board.column.label)
    about = f"{board.column.label.capitalize()}; the dashed line is the mean of those episodes."
    return {"Less data": f"{_table(panels, board)}\n{about}\n\n![by joint steps](sizes.png)\n"}


def _facts_of(dataset: str, found: Findings) -> list[Facts]:
    """Of the sizes of a dataset, the smallest first."""
    assert found.study.sizes is not None
    wanted = [sized(dataset, size) for size in found.study.sizes.sizes]
    facts = {
        found.facts[cell.name].id: found.facts[cell.name]
        for cell in found.cells
        if is_size(found.study, cell) and (cell.source, cell.n_steps) in wanted
    }
    return sorted(facts.values(), key=lambda each: each.figures.n_steps)


def _table(panels: Mapping[str, Lines], board: Board) -> str:
    """A row for each dataset and algorithm, a column for each size of that dataset."""
    rows = []
    for dataset, lines in panels.items():
        for label, points in lines.items():
            cells = [f"{n:,}: {_shown(points[n], board)}" for n in sorted(points)]
            rows.append((dataset, f"`{label}`", "; ".join(cells)))
    return markdown.table(("dataset", "algorithm", f"joint steps: {board.column.label}"), rows)


def _shown(each: Estimate, board: Board) -> str:
    """Of numbers that are in shown units already."""
    return format_estimate(each, replace(board.column, factor=1.0))
