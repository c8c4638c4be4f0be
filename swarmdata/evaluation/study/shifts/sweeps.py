"""The sweeps of a study: the best of each family in worse conditions, and sections on them."""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from swarmdata.drawing import markdown
from swarmdata.drawing.style import line_looks
from swarmdata.evaluation.figures.dot_plot import Looks
from swarmdata.evaluation.figures.line_plot import plot_lines
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.robustness.sweep import plan_sweep, run_sweep
from swarmdata.evaluation.robustness.sweep_axes import parse_axis
from swarmdata.evaluation.robustness.sweep_plots import PANEL_HEIGHT, axis_label, degradation_panel
from swarmdata.evaluation.robustness.sweep_tables import SWEEP_FILE, Degradation, read_csv
from swarmdata.evaluation.runs.job_options import JobOptions
from swarmdata.evaluation.study.cells.cells import Cell, offline_cell
from swarmdata.evaluation.study.cells.study_data import digest_of, short_name
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.plan import Study, SweepPlan, View
from swarmdata.numerics.random import SeedBlock
from swarmdata.specs.plain_names import without_version


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


def plan_sweeps(found: Findings) -> list[PlannedSweep]:
    """Chooses the best cell of each family on a sweep's dataset, for the datasets with results."""
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
        plan, folder = each.plan, each.folder(work)
        names = [str(cell.run_in(cell.folder(work))) for cell in each.cells]
        axis = parse_axis(plan.axis, plan.vary, plan.points)
        sweep = plan_sweep(names, [axis], folder, n_episodes=each.n_episodes, block=each.block)
        run_sweep(sweep, **options)
        table = out / sweep_table(each.label)
        table.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / SWEEP_FILE, table)


SWEEPS_FOLDER = "sweeps"  # of results in the folder of cells, and of tables beside the page

FIGURE = "robustness.png"

SOLVED = tuple(QUANTITIES[key].column for key in ("success", "clean_success"))


def sweep_table(label: str) -> str:
    """The table of a sweep, relative to the folder of the page."""
    return f"{SWEEPS_FOLDER}/{label}/{SWEEP_FILE}"


def read_sweeps(study: Study, folder: Path) -> dict[str, Degradation]:
    """Reads the sweeps of a study's plan that stand beside its page, by label."""
    files = {label: folder / sweep_table(label) for label in sorted(study.sweeps)}
    return {label: read_csv(file) for label, file in files.items() if file.exists()}


def sweep_sections(
    study: Study, sweeps: Mapping[str, Degradation], looks: Looks, out: Path
) -> list[tuple[str, str]]:
    """A figure of all sweeps, and what is left of each row at the worst value of each."""
    if not sweeps:
        return []
    plot_sweeps([*sweeps.values()], looks, out / FIGURE)
    whole = "Robustness", f"![success in worse conditions]({FIGURE})"
    return [whole, *(_section(study, *sweep) for sweep in sweeps.items())]


def _section(study: Study, label: str, found: Degradation) -> tuple[str, str]:
    plan = study.sweeps[label]
    models = {"observation": plan.observation, "communication": plan.communication}
    seen = ", ".join(f"{kind} `{model}`" for kind, model in models.items() if model)
    return f"Robustness: {found.part} {found.name}", (
        f"Data: {without_version(short_name(plan.dataset))}{f', {seen}' if seen else ''}; "
        f"{found.n_episodes:,} seeds at each value; changes are paired by training seed and "
        f"episode. [All values]({sweep_table(label)}).\n\n"
        f"{_table(label, found)}"
    )


def _table(label: str, found: Degradation) -> str:
    worst, change = found.lines[-1].points[-1].value, found.columns[-1]
    places = [found.column(column.key) for column in SOLVED]
    rows = []
    for line in found.lines:
        last = next(point for point in line.points if point.value == worst)
        solved = (
            format_estimate(point.estimates[place], column)
            for point in (line.trained, last)
            for place, column in zip(places, SOLVED, strict=True)
        )
        rows.append((f"`{line.label}`", *solved, format_difference(last.estimates[-1], change)))
    head = (
        label,
        *(f"{column.header}, as trained" for column in SOLVED),
        *(f"{column.header}, {found.name} {worst:g}" for column in SOLVED),
        change.label,
    )
    return markdown.table(head, rows)


def plot_sweeps(sweeps: Sequence[Degradation], looks: Looks, path: Path) -> None:
    """Draws a column for each sweep, success above clean success; worse values are on the right."""
    styles = {label: {**looks[label], **look} for label, look in line_looks(looks).items()}
    rows = []
    for column in SOLVED:
        row = [degradation_panel(each, column.key, styles)._replace(title="") for each in sweeps]
        rows.append([row[0]._replace(ylabel=column.header), *row[1:]])
    for k, each in enumerate(sweeps):
        label = axis_label(each).replace(" (", "\n(").replace(" of ", "\nof ", 1)
        rows[-1][k] = rows[-1][k]._replace(xlabel=label)
    plot_lines(rows, path, height=PANEL_HEIGHT, shares_x=True, shares_y="row", base=sweeps[0].base)
