"""Place and size: policies evaluated in tasks that they were not trained in."""

from pathlib import Path

from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.evaluation.study.shifts.shifted_estimate import shifted

TASKS_FOLDER = "tasks"
"""Holds results in the study's folder of cells: LABEL/DATA/TASK."""


def find_other_tasks(found: Findings, *, measure: bool) -> list[Shifted]:
    """Policies in the plan's other tasks.

    Args:
        found: what was measured.
        measure: whether to evaluate; results are kept in the folder of cells. Otherwise only what
            is kept is returned.
    """
    plan = found.study.tasks
    if plan is None:
        return []
    quantities = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    datasets = [short_name(dataset) for dataset in plan.datasets]
    rows = []
    for cell in found.cells:
        if cell.kind == "offline" and cell.data in datasets and cell.label in plan.algorithms:
            for task in plan.tasks:
                folder = found.work / TASKS_FOLDER / cell.label / cell.data / Path(task).stem
                place = Shifted(cell.data, cell.label, "", task, len(cell.seeds), plan.episodes, {})
                row = shifted(
                    found, cell, {"task": task}, folder, quantities, place, measure=measure
                )
                rows += [] if row is None else [row]
    return rows
