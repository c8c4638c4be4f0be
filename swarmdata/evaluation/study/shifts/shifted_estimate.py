"""Evaluates a finished cell's policies in other conditions."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.errors import PolicyFitError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.evaluation.results.result_tables import Quantity, estimate, quantities_of
from swarmdata.evaluation.results.target_evaluation import evaluate_target, kept_result
from swarmdata.evaluation.study.cells.cell_folder import cell_folder, cell_run_folder
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.shifts.shift_table import Shifted
from swarmdata.numerics.random import block_seeds

_LOG = logging.getLogger("swarmdata")


def shifted(
    found: Findings,
    cell: Cell,
    conditions: Mapping[str, object],
    results: Path,
    quantities: Sequence[Quantity],
    place: Shifted,
    *,
    measure: bool,
) -> Shifted | None:
    """Evaluates the policies of a cell; None if that was not done before and is not wanted now.

    A cell that was restored from a study's archive has results and no policies: it is None, too,
    and a warning says so where it is wanted.

    Args:
        found: what was measured.
        cell: a finished one.
        conditions: `task`, `observation` and `communication`, as `find_target` takes them.
        results: folder that keeps the episodes, so that an interrupted study resumes.
        quantities: to estimate.
        place: names of the conditions, and the number of seeds of the study's block.
        measure: whether to evaluate what is not kept.
    """
    run = cell_run_folder(cell, cell_folder(found.work, cell))
    if not run.is_dir():
        if measure:
            _LOG.warning(
                "%s has no policies in %s, so it is not evaluated in other conditions: make it "
                "again with --cell and --again", cell.name, found.work,
            )  # fmt: skip
        return None
    try:
        target = find_target(str(run), **conditions)  # type: ignore[arg-type]
    except PolicyFitError:
        return place
    block, n = found.study.block, place.n_episodes
    if measure:
        evaluated = evaluate_target(target, n, results, block=block, progress=False)
    else:
        seeds = block_seeds(block, n)
        kept = (kept_result(target.spec, each, seeds, results) for each in target.provenances)
        evaluated = [each for each in kept if each is not None]
    if len(evaluated) < len(target.policies):
        return None
    (case,) = group_results(evaluated).cases
    known = quantities_of(case)
    estimates = {
        each.column.key: estimate(each, case, cell.label) for each in quantities if each in known
    }
    return place._replace(estimates=estimates)
