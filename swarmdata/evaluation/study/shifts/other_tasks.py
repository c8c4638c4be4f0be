"""Place and size: policies evaluated in tasks that they were not trained in."""

from pathlib import Path

from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.shifts.shift import Shift, plan_shift
from swarmdata.evaluation.study.shifts.shift_table import Shifted

TASKS_FOLDER = "tasks"
"""Holds results in the study's folder of cells: LABEL/DATA/TASK."""


def plan_other_tasks(found: Findings) -> list[Shift]:
    """Returns the finished rows of the plan in each of its other tasks."""
    plan = found.study.tasks
    if plan is None:
        return []
    n_episodes = found.study.shifted_episodes(plan.episodes)
    datasets = [short_name(dataset) for dataset in plan.datasets]
    shifts = []
    for cell in found.cells:
        if cell.kind == "offline" and cell.data in datasets and cell.label in plan.algorithms:
            for task in plan.tasks:
                folder = found.work / TASKS_FOLDER / cell.label / cell.data / Path(task).stem
                place = Shifted(cell.data, cell.label, "", task, len(cell.seeds), n_episodes, {})
                shifts.append(plan_shift(found, cell, {"task": task}, folder, place))
    return shifts
