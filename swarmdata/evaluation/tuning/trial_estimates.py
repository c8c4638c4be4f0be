"""What the data alone say about a trained trial, as jobs that leave a ranking in its folder."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from swarmdata.evaluation.policy_selection.rank import rank
from swarmdata.evaluation.policy_selection.ranking_record import Ranking
from swarmdata.evaluation.runs.job_options import JobOptions, do_with_bar
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.study_data import open_dataset
from swarmdata.evaluation.tuning.tuning_record import ESTIMATES
from swarmdata.learn.evaluation.fqe import FQEConfig
from swarmdata.learn.training.run_folder import load_run
from swarmdata.runtime.engines.jobs import Handler, Job, Report
from swarmdata.store.split_rule import empty_validation

ESTIMATOR = f"{__name__}:estimator"

RANKING_FOLDER = "ranking"
"""Of a cell, beside its run and its results."""

FITS = FQEConfig(hidden=(64, 64), n_fits=3)
"""Three fits, of which the least is trusted, and networks that keep them as cheap as one."""


def why_without(cells: Sequence[Cell], work: Path) -> str | None:
    """Why policies of trained cells cannot be estimated from their data; None where they can."""
    policies = load_run(cells[0].run_in(cells[0].folder(work)))
    if not hasattr(policies[0], "actions"):
        return (
            f"the policies of {cells[0].algorithm} draw their actions or remember, so that what "
            "they would have done in recorded states is not known."
        )
    return why_without_data(cells)


def why_without_data(cells: Sequence[Cell]) -> str | None:
    """Why no policy can be estimated from the cells' data; None where that is possible."""
    for source, n_steps in {(cell.source, cell.n_steps) for cell in cells}:
        dataset = open_dataset(source, n_steps)
        if not len(dataset.split("validation")):
            return f"{dataset.id}: {empty_validation(len(dataset))}"
    return None


def run_estimates(cells: Sequence[Cell], work: Path, **options: Unpack[JobOptions]) -> None:
    """Ranks the policies of trained cells without a ranking; raises BatchError if some fail."""
    waiting = [cell for cell in cells if not _ranking_file(cell, work).exists()]
    jobs = [
        Job(f"estimates of {cell.name}", {"folder": str(cell.folder(work).resolve())})
        for cell in waiting
    ]
    do_with_bar(jobs, ESTIMATOR, "estimates", work, total=len(jobs), **options)


def read_estimates(cell: Cell, work: Path) -> dict[str, float]:
    """The criteria of a cell's policies, means over seeds, by name."""
    policies = Ranking.from_file(_ranking_file(cell, work)).policies
    return {
        name: float(np.mean([getattr(policy, name) for policy in policies])) for name in ESTIMATES
    }


def _ranking_file(cell: Cell, work: Path) -> Path:
    return cell.folder(work) / RANKING_FOLDER / "ranking.json"


def estimator() -> Handler:
    """Returns what ranks the policies of one cell in a process."""

    def handle(payload: dict[str, Any], report: Report) -> None:
        folder = Path(payload["folder"])
        cell = Cell.in_folder(folder)
        dataset = open_dataset(cell.source, cell.n_steps)
        made = rank(
            [cell.run_in(folder)],
            dataset_id=str(dataset.path),
            config=FITS,
            device=cell.device,
            progress=False,
        )
        made.write(folder / RANKING_FOLDER)
        report(1)

    return handle
