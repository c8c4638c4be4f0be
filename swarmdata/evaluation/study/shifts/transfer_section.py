"""The section on transfer: policies that learned in one view, evaluated in the others."""

from collections.abc import Mapping

from swarmdata.drawing import markdown
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, results_of
from swarmdata.evaluation.study.pages.information_section import label_of, view_cells
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shifted_estimate import shifted_estimates
from swarmdata.specs.task_spec import TaskSpec

TRANSFER_FOLDER = "transfer"
"""Holds results in the study's folder of cells: LABEL/DATA/VIEW."""


def run_transfers(found: Findings) -> dict[str, str]:
    """Evaluates policies of each view in the others, and returns the section by its title.

    Results are kept in the folder of cells, so that an interrupted study resumes.
    """
    plan = found.study.information
    if plan is None or not plan.transfer:
        return {}
    tables = []
    for dataset in map(short_name, plan.datasets):
        cells = list(view_cells(found, dataset))
        for label in plan.transfer:
            by_view = {label_of(plan, cell): cell for cell in cells if cell.label == label}
            ordered = {view: by_view[view] for view in plan.views if view in by_view}
            if ordered:
                tables.append(f"`{label}` on {dataset}:\n\n{_matrix(found, ordered)}")
    text = (
        "Rows are the view that a policy learned in, columns that of its evaluation, on "
        f"{plan.transfer_episodes:,} seeds: {quantity_of(found.results).column.label}.\n\n"
    )
    return {"Information: learned with one, used with another": text + "\n".join(tables)}


def _matrix(found: Findings, cells: Mapping[str, Cell]) -> str:
    """A row for each view that was learned in, a column for each of evaluation."""
    specs = {view: _spec_of(found, cell) for view, cell in cells.items()}
    rows = [
        (f"`{view}`", *(_transferred(found, cell, name, spec) for name, spec in specs.items()))
        for view, cell in cells.items()
    ]
    return markdown.table(("learned with", *cells), rows)


def _spec_of(found: Findings, cell: Cell) -> TaskSpec:
    """The spec that a cell's policies were evaluated in."""
    spec = results_of([cell], found.work)[0].spec.world
    assert spec is not None  # a cell of a recording of another environment is not evaluated
    return spec


def _transferred(found: Findings, cell: Cell, view: str, spec: TaskSpec) -> str:
    """The estimate of a cell's policies in another view, as text."""
    plan = found.study.information
    assert plan is not None
    (text,) = shifted_estimates(
        found,
        cell,
        {"observation": spec.observation, "communication": spec.communication},
        found.work / TRANSFER_FOLDER / cell.label / cell.data / view,
        (quantity_of(found.results),),
        plan.transfer_episodes,
    )
    return text
