"""Estimates of a finished cell's policies in other conditions, as texts of a table."""

from collections.abc import Mapping
from pathlib import Path

from swarmdata.errors import PolicyFitError
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import Quantity, estimate, quantities_of
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.study.cells.cell_folder import cell_folder, cell_run_folder
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.pages.collect_results import Findings

NO_FIT = "other inputs"
"""Stands where a policy cannot read what it would be given, or the robots are others."""


def shifted_estimates(
    found: Findings,
    cell: Cell,
    conditions: Mapping[str, object],
    results: Path,
    quantities: tuple[Quantity, ...],
    n_episodes: int,
) -> tuple[str, ...]:
    """Evaluates the policies of a cell, and returns a text for each quantity.

    Args:
        found: what was measured.
        cell: a finished one.
        conditions: `task`, `observation` and `communication`, as `find_target` takes them.
        results: folder that keeps the episodes, so that an interrupted study resumes.
        quantities: to estimate.
        n_episodes: seeds of the study's block.
    """
    run = cell_run_folder(cell, cell_folder(found.work, cell))
    try:
        target = find_target(str(run), **conditions)  # type: ignore[arg-type]
    except PolicyFitError:
        return (NO_FIT,) * len(quantities)
    files = evaluate_target(target, n_episodes, results, block=found.study.block, progress=False)
    (case,) = group_results(files).cases
    known = quantities_of(case)
    return tuple(
        format_estimate(estimate(each, case, cell.label), each.column)
        if each in known
        else UNDEFINED
        for each in quantities
    )
