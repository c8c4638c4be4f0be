"""The section on place and size: policies evaluated in tasks that they were not trained in."""

from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.result_tables import QUANTITIES, Quantity
from swarmdata.evaluation.study.cells.cell_folder import cell_folder, is_done
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.plan import TasksPlan
from swarmdata.evaluation.study.shifts.shifted_estimate import shifted_estimates

TASKS_FOLDER = "tasks"
"""Holds results in the study's folder of cells: LABEL/DATA/TASK."""


def run_tasks(found: Findings) -> dict[str, str]:
    """Evaluates policies in the plan's other tasks, and returns the section by its title.

    Results are kept in the folder of cells, so that an interrupted study resumes.
    """
    plan = found.study.tasks
    if plan is None:
        return {}
    quantities = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    tables = []
    for dataset in map(short_name, plan.datasets):
        rows = {
            cell.label: _estimates(found, cell, plan, quantities)
            for cell in found.cells
            if _is_planned(found, cell, plan, dataset)
        }
        for index, quantity in enumerate(quantities):
            shown = [
                (f"`{label}`", *(each[index] for each in columns))
                for label, columns in rows.items()
            ]
            head = (f"{dataset}: {quantity.column.header}", *plan.tasks)
            tables.append(markdown.table(head, shown))
    text = (
        "Policies of the study in tasks that they were not trained in, on "
        f"{plan.episodes:,} seeds. Sensors and radios are those of their training. A score is "
        "between doing nothing and the expert in each task.\n\n"
    )
    return {"Other places and sizes of teams": text + "\n".join(tables)}


def _is_planned(found: Findings, cell: Cell, plan: TasksPlan, dataset: str) -> bool:
    is_of_the_grid = cell.kind == "offline" and cell.data == dataset
    folder = cell_folder(found.work, cell)
    return is_of_the_grid and cell.label in plan.algorithms and is_done(cell, folder)


def _estimates(
    found: Findings, cell: Cell, plan: TasksPlan, quantities: tuple[Quantity, ...]
) -> list[tuple[str, ...]]:
    """A text for each quantity, for each task."""
    place = found.work / TASKS_FOLDER / cell.label / cell.data
    return [
        shifted_estimates(
            found, cell, {"task": task}, place / Path(task).stem, quantities, plan.episodes
        )
        for task in plan.tasks
    ]
