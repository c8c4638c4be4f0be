"""Collects what the finished cells of a study measured: results, data, costs, training curves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from swarmdata.drawing.style import family_looks
from swarmdata.errors import StudyError
from swarmdata.evaluation.results.learning_curves import Curve
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.evaluation.results.result_set import ResultSet, case_order, group_results
from swarmdata.evaluation.results.result_tables import QUANTITIES, Quantity
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cells import (
    COST_FILE,
    DATA_FILE,
    ONLINE_FAMILY,
    RESULTS_FOLDER,
    Cell,
)
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, dataset_of_size, short_name
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.run_files import read_table


@dataclass(frozen=True, eq=False)
class Findings:
    """Everything that the pages are written from."""

    study: Study  # the plan
    cells: tuple[Cell, ...]  # that are done
    missing: Mapping[str, str]  # names of the other cells, with the reason if they failed
    results: ResultSet  # on the study's datasets, with online algorithms as baselines
    sizes: ResultSet | None  # of the data efficiency; None: nothing was measured
    views: ResultSet | None  # of other views of the data, or of the task; None: the same
    facts: Mapping[str, DatasetFacts]  # cell's name -> of the dataset that it was trained on
    costs: Mapping[str, Cost]  # cell's name -> its cost
    work: Path  # folder of the cells

    def family(self, label: str) -> str:
        """The family of an algorithm of the study."""
        known = self.study.algorithms.get(label)
        return ONLINE_FAMILY if known is None else known.family

    @property
    def families(self) -> dict[str, str]:
        """The family of each offline row, in the order of the plan."""
        return {label: each.family for label, each in self.study.algorithms.items()}

    @property
    def view_families(self) -> dict[str, str]:
        """The family of each row that was measured in views, offline ones first."""
        if self.views is None or self.study.information is None:
            return {}
        offline = {label: self.family(label) for label in self.study.information.algorithms}
        measured = (label for case in self.views.cases for label in case.runs)
        return {label: offline.get(label, ONLINE_FAMILY) for label in (*offline, *measured)}

    @property
    def dataset_ids(self) -> dict[str, str]:
        """Short name of each dataset with finished offline cells -> its id."""
        cells = (cell for cell in self.cells if cell.kind == "offline")
        return {cell.data: self.facts[cell.name].id for cell in cells}

    @property
    def core(self) -> ResultSet:
        """The results on the core alone."""
        ids = {self.dataset_ids.get(short_name(name)) for name in self.study.core}
        cases = tuple(case for case in self.results.cases if case.name in ids)
        return replace(self.results, cases=cases)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What is compared in other conditions and in pairs, the score or return first."""
        return quantity_of(self.results), QUANTITIES["success"], QUANTITIES["clean_success"]

    @cached_property
    def main(self) -> Scoreboard:
        """The scoreboard of the score; of the return, if a world has no measured references."""
        return self.board(quantity_of(self.results).column.key)

    def board(self, key: str) -> Scoreboard:
        """The scoreboard of a quantity of the offline rows."""
        return make_scoreboard(self.results, self.families, key)

    @property
    def looks(self) -> dict[str, dict[str, str]]:
        """The color and marker of each offline row, in all figures of the study."""
        return family_looks(self.families)

    def training_curve(self, cell: Cell, file: str, column: str) -> Curve | None:
        """A column of a cell's losses or learning curve; None if it was not recorded.

        Its progress is in gradient updates; that of an online cell in joint steps.
        """
        path = cell.run_in(cell.folder(self.work)) / file
        rows = [row for row in read_table(path) if column in row] if path.exists() else []
        if not rows:
            return None
        progress = "frames" if cell.kind == "online" else "update"
        rows_by_seed = [[row for row in rows if row["seed"] == seed] for seed in cell.seeds]
        length = min(map(len, rows_by_seed))
        return Curve(
            np.array([row[progress] for row in rows_by_seed[0][:length]]),
            np.array([[row[column] for row in seed_rows[:length]] for seed_rows in rows_by_seed]),
        )


def collect_findings(
    study: Study, cells: Sequence[Cell], work: Path, failures: Mapping[str, str]
) -> Findings:
    """Reads the results of the cells that are done, and why others failed, by name.

    Raises:
        ResultsError: the results cannot be compared.
    """
    done = tuple(cell for cell in cells if cell.is_done(cell.folder(work)))
    missing = {
        cell.name: failures.get(cell.name, "not run yet") for cell in cells if cell not in done
    }
    files = {cell.name: cell.folder(work) / DATA_FILE for cell in done}
    facts = {name: DatasetFacts.from_file(file) for name, file in files.items() if file.exists()}
    grid = [cell for cell in done if is_in_grid(study, cell)]
    if not any(cell.kind == "offline" for cell in grid):
        raise StudyError(
            f"no cell on the study's datasets is done in {work}, so there is nothing to write"
        )
    sized = [cell for cell in done if is_data_efficiency_cell(study, cell)]
    viewed = [cell for cell in done if is_view_cell(study, cell)]
    results, excluded = _without_other_worlds(_read_results(grid, work, facts))
    return Findings(
        study=study,
        cells=done,
        missing={**missing, **excluded},
        results=results,
        sizes=_read_results(sized, work, facts) if sized else None,
        views=_read_results(viewed, work, facts, has_baselines=True) if viewed else None,
        facts=facts,
        costs={cell.name: Cost.from_file(cell.folder(work) / COST_FILE) for cell in done},
        work=work,
    )


def _without_other_worlds(results: ResultSet) -> tuple[ResultSet, dict[str, str]]:
    """Leaves out online algorithms that were not evaluated in the world of any dataset."""
    specs = {case.spec.hash() for case in results.cases}
    same = tuple(case for case in results.baselines if case.spec.hash() in specs)
    others = {
        label: f"it was trained in spec {case.spec.hash()[:12]}, which no dataset here has"
        for case in results.baselines
        if case.spec.hash() not in specs
        for label in case.runs
    }
    return replace(results, baselines=same), others


def is_in_grid(study: Study, cell: Cell) -> bool:
    """Whether a cell is in the grid, or online as recorded; those of sizes and sweeps are not."""
    if cell.observation is not None or cell.communication is not None:
        return False
    return cell.kind != "offline" or (cell.source in study.datasets and cell.n_steps is None)


def is_data_efficiency_cell(study: Study, cell: Cell) -> bool:
    """Whether a cell is a point of the data-efficiency figure."""
    if study.sizes is None or cell.label not in study.sizes.algorithms or "~" in cell.data:
        return False
    wanted = [dataset_of_size(d, size) for d in study.sizes.datasets for size in study.sizes.sizes]
    return (cell.source, cell.n_steps) in wanted


def is_view_cell(study: Study, cell: Cell) -> bool:
    """Whether a cell is of the data seen and heard in one of the study's ways."""
    plan = study.information
    if plan is None:
        return False
    is_offline = cell.source in plan.datasets and cell.label in plan.algorithms
    if not is_offline and cell.label not in plan.online:
        return False
    models = {view.models for view in plan.views.values()}
    return cell.n_steps is None and (cell.observation, cell.communication) in models


def _read_results(
    cells: Sequence[Cell],
    work: Path,
    facts: Mapping[str, DatasetFacts],
    has_baselines: bool = False,
) -> ResultSet:
    """The results of cells by case, with the facts of their data, and perhaps with online rows."""
    found, known, cases = group_results(results_of(cells, work)), facts_by_dataset(facts), []
    for case in found.cases:
        key = str(case.dataset)  # a view has the same episodes; mixtures have facts of their own
        data = known.get(key, known.get(key.partition("@")[0]))
        cases.append(case if data is None else replace(case, data=data.figures))
    cases.sort(key=case_order)
    found = replace(found, cases=tuple(cases))
    return replace(found, cases=tuple(map(found.with_baselines, cases))) if has_baselines else found


def facts_by_dataset(facts: Mapping[str, DatasetFacts]) -> dict[str, DatasetFacts]:
    """The facts of each dataset, by its id."""
    return {each.id: each for each in facts.values()}


def results_of(cells: Sequence[Cell], work: Path) -> list[Result]:
    """Reads all results of finished cells."""
    folders = [cell.folder(work) / RESULTS_FOLDER for cell in cells]
    return [load_result(file) for folder in folders for file in sorted(folder.glob("*.json"))]
