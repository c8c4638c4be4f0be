"""Information: algorithms on the same data, seen and heard in other ways."""

from collections.abc import Iterator
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.drawing.style import family_looks
from swarmdata.evaluation.figures.dot_plot import plot_by_dataset
from swarmdata.evaluation.results.estimate_table import UNDEFINED, Column, format_estimate
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_view_cell, results_of
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.plan import ViewsPlan
from swarmdata.rollouts.score_statistics import Estimate

QUANTITIES_BESIDE = ("success", "clean_success", "robot_collisions", "obstacle_collisions")
"""Of a table each, after the score's."""


def information_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title; empty if nothing of it was measured.

    Args:
        found: what was measured.
        out: folder for the figures.
    """
    plan = found.study.information
    if plan is None or found.views is None:
        return {}
    families = found.view_families
    keys = (quantity_of(found.views).column.key, *QUANTITIES_BESIDE)
    boards = [make_scoreboard(found.views, families, key) for key in keys]
    models = [
        (f"`{label}`", *(each or "as recorded" for each in view.models))
        for label, view in plan.views.items()
    ]
    parts = [
        "Trained and evaluated with the same models:\n",
        markdown.table(("view", "observation", "communication"), models),
    ]
    for dataset in map(short_name, plan.datasets):
        columns = dict(view_columns(found, dataset))
        if columns:
            parts += [_panel(board, dataset, columns) for board in boards]
            parts.append(_figure(found, boards[0], dataset, columns, out))
    return {"Information: trained and evaluated with it": "\n".join(parts)}


def label_of(plan: ViewsPlan, cell: Cell) -> str:
    """What the plan calls the view of a cell."""
    models = (cell.observation, cell.communication)
    return next(label for label, view in plan.views.items() if view.models == models)


def view_cells(found: Findings, dataset: str) -> Iterator[Cell]:
    """The finished offline cells of the views of a dataset, by its short name."""
    for cell in found.cells:
        is_offline = cell.kind == "offline" and short_name(cell.source) == dataset
        if is_offline and is_view_cell(found.study, cell):
            yield cell


def view_columns(found: Findings, dataset: str) -> Iterator[tuple[str, str]]:
    """Labels of views in the plan's order, and the names of their cases."""
    plan = found.study.information
    assert plan is not None
    keys = {}
    for cell in view_cells(found, dataset):
        provenance = results_of([cell], found.work)[0].provenance
        keys[label_of(plan, cell)] = str(provenance.dataset_key)
    return ((label, keys[label]) for label in plan.views if label in keys)


def _panel(board: Scoreboard, dataset: str, columns: dict[str, str]) -> str:
    """A row for each algorithm, a column for each view."""
    rows = []
    for label in board.families:
        cells = (board.estimates.get(name, {}).get(label) for name in columns.values())
        rows.append((f"`{label}`", *(_text(each, board.column) for each in cells)))
    head = (f"{dataset}: {board.column.label}", *columns)
    return markdown.table(head, rows)


def _text(found: Estimate | None, column: Column) -> str:
    return UNDEFINED if found is None else format_estimate(found, column)


def _figure(
    found: Findings, board: Scoreboard, dataset: str, columns: dict[str, str], out: Path
) -> str:
    shown = {
        label: board.in_shown_units(name)
        for label, name in columns.items()
        if name in board.estimates
    }
    data = {
        label: board.column.factor * board.data[name]
        for label, name in columns.items()
        if name in board.data
    }
    file = f"information-{dataset}.png"
    looks = family_looks({**found.families, **board.families})
    plot_by_dataset(
        shown, data, looks, out / file, label=board.column.label, families=board.families
    )
    return f"![{board.column.label} by view]({file})\n"
