"""The same algorithms on smaller parts of the same data, and on data seen and heard otherwise."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.drawing.style import DATA_LINE, thousands
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.figures.line_plot import Line, LinePanel, plot_lines
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import UNDEFINED_ESTIMATE
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.collect_results import (
    Findings,
    is_data_efficiency_cell,
    is_view_cell,
    results_of,
)
from swarmdata.evaluation.study.pages.scoreboard import (
    SCALE_LIMIT,
    Scoreboard,
    make_scoreboard,
    quantity_of,
)

FIGURE = "information.png"

QUANTITIES_BESIDE = ("success", "clean_success", "robot_collisions", "obstacle_collisions")
"""Of a table each, after the score's."""


def information_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title; empty if nothing of it was measured."""
    plan = found.study.information
    if plan is None or found.views is None:
        return {}
    boards = _boards(found.views, found.view_families)
    models = [
        (f"`{label}`", *(each or "as recorded" for each in view.models))
        for label, view in plan.views.items()
    ]
    parts = [
        "Trained and evaluated with the same models:\n",
        markdown.table(("view", "observation", "communication"), models),
    ]
    measured = _measured(found)
    for dataset, columns in measured.items():
        parts += [_panel(board, dataset, columns) for board in boards]
    if measured:
        _plot(boards[0], measured, tuple(plan.views), out / FIGURE)
        parts.append(f"![{boards[0].column.label} by view]({FIGURE})\n")
    return {"Information: trained and evaluated with it": "\n".join(parts)}


def _boards(views: ResultSet, families: Mapping[str, str]) -> list[Scoreboard]:
    keys = (quantity_of(views).column.key, *QUANTITIES_BESIDE)
    return [make_scoreboard(views, families, key) for key in keys]


def _measured(found: Findings) -> dict[str, dict[str, str]]:
    """Short name of each dataset with results -> view, in the plan's order -> name of the case."""
    plan = found.study.information
    assert plan is not None
    columns = {
        dataset: {
            view: str(results_of([cell], found.work)[0].provenance.dataset_key)
            for view, cell in view_cells(found, dataset)
        }
        for dataset in map(short_name, plan.datasets)
    }
    return {dataset: names for dataset, names in columns.items() if names}


def view_rows(found: Findings) -> list[dict[str, object]]:
    """One row per dataset, view, row of the study and quantity, in stored units."""
    if found.views is None:
        return []
    head = ("dataset", "view", "label", "quantity", "mean", "low", "high")
    return [
        dict(zip(head, (dataset, view, label, board.column.key, *estimate), strict=True))
        for board in _boards(found.views, found.view_families)
        for dataset, views in _measured(found).items()
        for view, name in views.items()
        for label, estimate in board.estimates.get(name, {}).items()
    ]


def view_cells(found: Findings, dataset: str) -> Iterator[tuple[str, Cell]]:
    """The views of a dataset in the plan's order, each with every finished offline cell of it."""
    plan = found.study.information
    for label, view in plan.views.items() if plan else ():
        for cell in found.cells:
            is_offline = cell.kind == "offline" and short_name(cell.source) == dataset
            models = (cell.observation, cell.communication)
            if is_offline and models == view.models and is_view_cell(found.study, cell):
                yield label, cell


def _panel(board: Scoreboard, dataset: str, columns: dict[str, str]) -> str:
    found = {}
    for label in board.families:
        for view, name in columns.items():
            known = board.estimates.get(name, {}).get(label, UNDEFINED_ESTIMATE)
            found[label, view] = format_estimate(known, board.column)
    return markdown.pivot(f"{dataset}: {board.column.label}", columns, found)


def _plot(
    board: Scoreboard, views: Mapping[str, Mapping[str, str]], order: Sequence[str], path: Path
) -> None:
    """Draws a row for each view, a column for each dataset and algorithm.

    Colors are changes from the first view.
    """
    cells: dict[tuple[str, str], MatrixCell] = {}
    columns: dict[str, list[str]] = {}
    for dataset, names in views.items():
        shown = {view: board.in_shown_units(each) for view, each in names.items()}
        first = shown[next(iter(shown))]
        labels = {label: f"{dataset}: {label}" for label in board.families if label in first}
        columns[dataset] = [*labels.values()]
        for view, found in shown.items():
            best = board.leaders(names[view]) if len(labels) > 1 else []
            for label, column in labels.items():
                if label in found:
                    change = found[label].value - first[label].value
                    cells[view, column] = MatrixCell(found[label].value, change, label in best)
    rows = [view for view in order if any(view in names for names in views.values())]
    notes = Notes(
        SCALE_LIMIT,
        f"{board.column.label} minus that in the first row",
        "framed: the best of a dataset in this row and those not clearly worse (paired)",
    )
    plot_matrix(cells, {"": rows}, columns, path, notes)


PANEL_HEIGHT = 2.0  # inches


def size_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title, with a figure in a folder; empty if nothing of it was measured."""
    results, plan = found.sizes, found.study.sizes
    if results is None or plan is None:
        return {}
    families = {label: found.family(label) for label in plan.algorithms}
    board = make_scoreboard(results, families, quantity_of(results).column.key)
    cells = [cell for cell in found.cells if is_data_efficiency_cell(found.study, cell)]
    parts: dict[str, list[DatasetFacts]] = {}  # those with several sizes, the smallest first
    for dataset in plan.datasets:
        wanted = [dataset_of_size(dataset, size) for size in plan.sizes]
        facts = [found.facts[c.name] for c in cells if (c.source, c.n_steps) in wanted]
        measured = {each.id: each for each in facts if each.id in results.datasets}
        if len(measured) > 1:
            sizes = sorted(measured.values(), key=lambda each: each.figures.n_steps)
            parts[short_name(dataset)] = sizes
    if not parts:
        return {}
    row = [_size_panel(board, dataset, facts, found.looks) for dataset, facts in parts.items()]
    row[0] = row[0]._replace(ylabel=board.column.label)
    xlabel = "joint steps of data"
    plot_lines([row], out / "sizes.png", height=PANEL_HEIGHT, xlabel=xlabel, shares_y="row")
    caption = f"{board.column.label.capitalize()}; the dashed line is the mean of those episodes."
    body = f"{_size_table(board, parts)}\n{caption}\n\n![by joint steps](sizes.png)"
    return {"Data efficiency": body}


def _size_panel(
    board: Scoreboard, dataset: str, sizes: Sequence[DatasetFacts], looks: Looks
) -> LinePanel:
    shown = {facts.figures.n_steps: board.in_shown_units(facts.id) for facts in sizes}
    lines = []
    for label in dict.fromkeys(label for found in shown.values() for label in found):
        steps = [n for n, found in shown.items() if label in found]
        ends = np.array([shown[n][label] for n in steps]).T
        lines.append(Line(label, np.array(steps, np.float64), ends, looks[label]))
    factor, known = board.column.factor, [each for each in sizes if each.id in board.data]
    means = {each.figures.n_steps: factor * board.data[each.id] for each in known}
    if means:
        ends = np.array([list(means.values())] * 3)
        lines.append(Line("mean of the data", np.array(list(means), np.float64), ends, DATA_LINE))
    # 200037 as 200k: a size has whole episodes, so a few more steps than asked for
    rounded = {n: round(n, 1 - len(str(n))) if n >= 10_000 else n for n in means or shown}
    ticks = {float(n): thousands(steps) for n, steps in rounded.items()}
    return LinePanel(dataset, lines, xscale="log", ticks=ticks)


def _size_table(board: Scoreboard, parts: Mapping[str, Sequence[DatasetFacts]]) -> str:
    """A row for each dataset and algorithm, with the estimates of all sizes of that dataset."""
    rows: dict[tuple[str, str], list[str]] = {}
    for dataset, sizes in parts.items():
        for each in sizes:
            for label, estimate in board.estimates[each.id].items():
                text = f"{each.figures.n_steps:,}: {format_estimate(estimate, board.column)}"
                rows.setdefault((dataset, f"`{label}`"), []).append(text)
    head = ("dataset", "algorithm", f"joint steps: {board.column.label}")
    return markdown.table(head, [(*names, "; ".join(texts)) for names, texts in rows.items()])
