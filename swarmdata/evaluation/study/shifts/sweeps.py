"""The sweeps of a study: the best of each family under worse communication or sensing."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from swarmdata.evaluation.robustness.sweep import plan_sweep, run_sweep
from swarmdata.evaluation.robustness.sweep_axes import parse_axis
from swarmdata.evaluation.robustness.sweep_tables import SWEEP_FILE
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cells import Cell, offline_cell
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.plan import SweepPlan, View
from swarmdata.evaluation.study.shifts.sweep_sections import SWEEPS_FOLDER
from swarmdata.numerics.random import SeedBlock


@dataclass(frozen=True)
class PlannedSweep:
    """One sweep of a study and its cells, one for each family."""

    label: str
    plan: SweepPlan
    cells: tuple[Cell, ...]
    n_episodes: int  # seeds of each value
    block: SeedBlock  # of these seeds

    @property
    def key(self) -> str:
        """Hash of everything that decides the sweep's results."""
        plan = {**self.plan.model_dump(mode="json"), "episodes": self.n_episodes}
        content = [plan, self.block, [cell.key for cell in self.cells]]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def folder(self, work: Path) -> Path:
        """Where its results are kept, in the folder of cells."""
        return work / SWEEPS_FOLDER / f"{self.label}-{self.key[:12]}"

    def is_ready(self, work: Path) -> bool:
        """Whether all its cells are done."""
        return all(cell.is_done(cell.folder(work)) for cell in self.cells)

    def is_measured(self, work: Path) -> bool:
        """Whether all its points were evaluated."""
        return self.is_ready(work) and (self.folder(work) / SWEEP_FILE).exists()


def plan_sweeps(found: Findings, digest_of: Callable[[str], str]) -> list[PlannedSweep]:
    """Chooses the cells of each sweep: the best of each family on its dataset.

    A sweep whose dataset has no results yet is left out.
    """
    study, planned = found.study, []
    for label, plan in study.sweeps.items():
        dataset = found.dataset_ids.get(short_name(plan.dataset), "")
        if dataset in found.main.estimates:
            best = found.main.best_by_family(dataset)
            view = View(observation=plan.observation, communication=plan.communication)
            cells = tuple(
                offline_cell(study, best[family], plan.dataset, digest_of, view=view)
                for family in plan.families or study.families
                if family in best
            )
            n_episodes = study.shifted_episodes(plan.episodes)
            planned.append(PlannedSweep(label, plan, cells, n_episodes, study.block))
    return planned


def run_sweeps(
    planned: Sequence[PlannedSweep], work: Path, out: Path, **options: Unpack[JobOptions]
) -> None:
    """Runs sweeps whose cells are done, and puts their tables into the folder of the page.

    An interrupted sweep resumes in the folder of cells.
    """
    for each in planned:
        plan = each.plan
        folder = each.folder(work)
        names = [str(cell.run_in(cell.folder(work))) for cell in each.cells]
        axis = parse_axis(plan.axis, plan.vary, plan.points)
        sweep = plan_sweep(names, [axis], folder, n_episodes=each.n_episodes, block=each.block)
        run_sweep(sweep, **options)
        page_folder = out / SWEEPS_FOLDER / each.label
        page_folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / SWEEP_FILE, page_folder / SWEEP_FILE)
