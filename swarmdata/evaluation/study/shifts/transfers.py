"""Transfer: policies that learned in one view, evaluated in the others."""

from collections.abc import Iterator

from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings, results_of
from swarmdata.evaluation.study.pages.information_section import label_of, view_cells
from swarmdata.evaluation.study.shifts.shift import Shift, plan_shift
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.specs.task_spec import TaskSpec

TRANSFER_FOLDER = "transfer"
"""Holds results in the study's folder of cells: LABEL/DATA/VIEW."""


def plan_transfers(found: Findings) -> list[Shift]:
    """Returns the finished rows of each view in all views of the plan."""
    plan = found.study.information
    if plan is None:
        return []
    shifts = []
    for dataset in map(short_name, plan.datasets):
        for label in plan.transfer:
            known = {
                label_of(plan, cell): cell
                for cell in view_cells(found, dataset)
                if cell.label == label
            }
            cells = {view: known[view] for view in plan.views if view in known}
            specs = {view: _spec_of(found, cell) for view, cell in cells.items()}
            shifts += [
                shift for view, cell in cells.items() for shift in _from(found, view, cell, specs)
            ]
    return shifts


def _spec_of(found: Findings, cell: Cell) -> TaskSpec:
    """The spec that a cell's policies were evaluated in."""
    spec = results_of([cell], found.work)[0].spec.world
    assert spec is not None  # a cell of a recording of another environment is not evaluated
    return spec


def _from(found: Findings, view: str, cell: Cell, specs: dict[str, TaskSpec]) -> Iterator[Shift]:
    """The policies that learned in one view, in all views."""
    plan = found.study.information
    assert plan is not None
    for other, spec in specs.items():
        dataset, n = short_name(cell.source), found.study.shifted_episodes(plan.transfer_episodes)
        place = Shifted(dataset, cell.label, view, other, len(cell.seeds), n, {})
        models = {"observation": spec.observation, "communication": spec.communication}
        folder = found.work / TRANSFER_FOLDER / cell.label / cell.data / other
        yield plan_shift(found, cell, models, folder, place)
