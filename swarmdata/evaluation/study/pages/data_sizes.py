"""Data efficiency: the same algorithms on smaller parts of the same data."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.drawing.style import DATA_LINE, thousands
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.figures.line_plot import Line, LinePanel, plot_lines
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_data_efficiency_cell
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of

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
    row = [_panel(board, dataset, facts, found.looks) for dataset, facts in parts.items()]
    row[0] = row[0]._replace(ylabel=board.column.label)
    xlabel = "joint steps of data"
    plot_lines([row], out / "sizes.png", height=PANEL_HEIGHT, xlabel=xlabel, shares_y="row")
    caption = f"{board.column.label.capitalize()}; the dashed line is the mean of those episodes."
    return {"Data efficiency": f"{_table(board, parts)}\n{caption}\n\n![by joint steps](sizes.png)"}


def _panel(
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


def _table(board: Scoreboard, parts: Mapping[str, Sequence[DatasetFacts]]) -> str:
    """A row for each dataset and algorithm, with the estimates of all sizes of that dataset."""
    rows: dict[tuple[str, str], list[str]] = {}
    for dataset, sizes in parts.items():
        for each in sizes:
            for label, estimate in board.estimates[each.id].items():
                text = f"{each.figures.n_steps:,}: {format_estimate(estimate, board.column)}"
                rows.setdefault((dataset, f"`{label}`"), []).append(text)
    head = ("dataset", "algorithm", f"joint steps: {board.column.label}")
    return markdown.table(head, [(*names, "; ".join(texts)) for names, texts in rows.items()])
