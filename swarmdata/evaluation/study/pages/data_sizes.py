"""Data efficiency: the same algorithms on smaller parts of the same data."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, is_data_efficiency_cell
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.pages.study_figures import plot_sizes
from swarmdata.rollouts.score_statistics import Estimate

EstimatesBySize = dict[str, dict[int, Estimate]]
"""Label -> joint steps -> estimate."""


class SizedScores(NamedTuple):
    """What algorithms reach with smaller parts of the same data."""

    board: Scoreboard  # of the score; its datasets are the parts
    ids: dict[str, dict[int, str]]  # dataset -> joint steps -> the part on the board
    panels: dict[str, EstimatesBySize]  # dataset -> estimates in shown units
    data: dict[str, dict[int, float]]  # dataset -> joint steps -> mean of those episodes


def sized_scores(found: Findings) -> SizedScores | None:
    """The scores of a study's parts of datasets; None if no dataset has two that were measured."""
    if found.sizes is None or found.study.sizes is None:
        return None
    families = {label: found.family(label) for label in found.study.sizes.algorithms}
    board = make_scoreboard(found.sizes, families, quantity_of(found.sizes).column.key)
    scores = SizedScores(board, {}, {}, {})
    for dataset in found.study.sizes.datasets:
        parts = _facts_of(dataset, found)
        for facts in parts if len(parts) > 1 else ():
            _add(scores, short_name(dataset), facts)
    return scores if scores.panels else None


def _add(scores: SizedScores, dataset: str, facts: DatasetFacts) -> None:
    """Adds one part of a dataset."""
    board, n_steps = scores.board, facts.figures.n_steps
    if facts.id in board.estimates:
        scores.ids.setdefault(dataset, {})[n_steps] = facts.id
        for label, each in board.in_shown_units(facts.id).items():
            scores.panels.setdefault(dataset, {}).setdefault(label, {})[n_steps] = each
    if facts.id in board.data:
        mean = board.column.factor * board.data[facts.id]
        scores.data.setdefault(dataset, {})[n_steps] = mean


def size_section(found: Findings, out: Path) -> dict[str, str]:
    """The section by its title; empty if nothing of it was measured.

    Args:
        found: what was measured.
        out: folder for the figure.
    """
    scores = sized_scores(found)
    if scores is None:
        return {}
    label = scores.board.column.label
    plot_sizes(scores.panels, scores.data, found.looks, out / "sizes.png", ylabel=label)
    caption = f"{label.capitalize()}; the dashed line is the mean of those episodes."
    figure = "![by joint steps](sizes.png)"
    return {"Data efficiency": f"{size_table(scores)}\n{caption}\n\n{figure}\n"}


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


def size_table(scores: SizedScores) -> str:
    """A row for each dataset and algorithm, with the estimates of all sizes of that dataset."""
    column = replace(scores.board.column, factor=1.0)  # the numbers have shown units already
    rows = []
    for dataset, lines in scores.panels.items():
        for label, points in lines.items():
            cells = [f"{n:,}: {format_estimate(points[n], column)}" for n in sorted(points)]
            rows.append((dataset, f"`{label}`", "; ".join(cells)))
    return markdown.table(("dataset", "algorithm", f"joint steps: {column.label}"), rows)
