"""Transfer: policies that learned in one view, evaluated in the others."""

from collections.abc import Iterator

from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, results_of
from swarmdata.evaluation.study.pages.information_section import label_of, view_cells
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.evaluation.study.shifts.shifted_estimate import shifted
from swarmdata.specs.task_spec import TaskSpec

TRANSFER_FOLDER = "transfer"
"""Holds results in the study's folder of cells: LABEL/DATA/VIEW."""


def find_transfers(found: Findings, *, measure: bool) -> list[Shifted]:
    """Policies of each view in the others.

    Args:
        found: what was measured.
        measure: whether to evaluate; results are kept in the folder of cells. Otherwise only what
            is kept is returned.
    """
    plan = found.study.information
    if plan is None:
        return []
    rows = []
    for dataset in map(short_name, plan.datasets):
        for label in plan.transfer:
            known = {
                label_of(plan, cell): cell
                for cell in view_cells(found, dataset)
                if cell.label == label
            }
            cells = {view: known[view] for view in plan.views if view in known}
            specs = {view: _spec_of(found, cell) for view, cell in cells.items()}
            rows += [
                row for view in cells for row in _from(found, view, cells[view], specs, measure)
            ]
    return rows


def _spec_of(found: Findings, cell: Cell) -> TaskSpec:
    """The spec that a cell's policies were evaluated in."""
    spec = results_of([cell], found.work)[0].spec.world
    assert spec is not None  # a cell of a recording of another environment is not evaluated
    return spec


def _from(
    found: Findings, view: str, cell: Cell, specs: dict[str, TaskSpec], measure: bool
) -> Iterator[Shifted]:
    """The policies that learned in one view, in all views."""
    plan = found.study.information
    assert plan is not None
    quantities = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    for other, spec in specs.items():
        dataset, n = short_name(cell.source), plan.transfer_episodes
        place = Shifted(dataset, cell.label, view, other, len(cell.seeds), n, {})
        models = {"observation": spec.observation, "communication": spec.communication}
        folder = found.work / TRANSFER_FOLDER / cell.label / cell.data / other
        row = shifted(found, cell, models, folder, quantities, place, measure=measure)
        if row is not None:
            yield row
