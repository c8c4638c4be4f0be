"""What the finished cells of a study found: results, data, costs and tracks of training."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from swarmdata.errors import StudyError
from swarmdata.evaluation.results.curve_plots import Curve
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.evaluation.results.result_set import Case, ResultSet, gather
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cell_worker import COST, DATA, RESULTS, is_done, run_of
from swarmdata.evaluation.study.cells.cells import ONLINE_FAMILY, Cell
from swarmdata.evaluation.study.cells.run_cells import folder_of
from swarmdata.evaluation.study.cells.study_data import Facts, named, sized
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.run_files import CURVE, LOSSES
from swarmdata.learn.training.run_folder import read_table


@dataclass(frozen=True, eq=False)
class Findings:
    """Everything that pages are written from.

    Attributes:
        study: what was asked for.
        cells: that are done.
        missing: names of cells that are not, with the reason where they failed.
        results: of the study's datasets, and of online algorithms as baselines.
        sizes: of the data efficiency, where it was asked for and measured.
        facts: of the dataset of each cell that trained on one, by the cell's name.
        costs: by cell.
        work: folder of the cells.
    """

    study: Study
    cells: tuple[Cell, ...]
    missing: Mapping[str, str]
    results: ResultSet
    sizes: ResultSet | None
    facts: Mapping[str, Facts]
    costs: Mapping[str, Cost]
    work: Path

    def family(self, label: str) -> str:
        """Of an algorithm of the study."""
        known = self.study.algorithms.get(label)
        return ONLINE_FAMILY if known is None else known.family

    def curve(self, cell: Cell, column: str, *, file: str = LOSSES) -> Curve | None:
        """A column of a cell's losses or learning curve, None where it has none of it.

        Args:
            cell: of the study.
            column: of the file.
            file: `losses.csv` or `curve.csv` of the run.
        """
        path = run_of(cell, folder_of(self.work, cell)) / file
        rows = [row for row in read_table(path) if column in row] if path.exists() else []
        if not rows:
            return None
        tracks = [[row for row in rows if row["seed"] == seed] for seed in cell.seeds]
        length = min(map(len, tracks))
        return Curve(
            np.array([row["update"] for row in tracks[0][:length]]),
            np.array([[row[column] for row in track[:length]] for track in tracks]),
        )

    def learning(self, cell: Cell, metric: str) -> Curve | None:
        """A metric of a cell's learning curve."""
        return self.curve(cell, metric, file=CURVE)


def findings_of(
    study: Study, cells: Sequence[Cell], work: Path, failures: Mapping[str, str]
) -> Findings:
    """Reads what is done of a study.

    Args:
        study: the file.
        cells: that it asks for.
        work: folder of the cells.
        failures: why cells failed, by name.

    Raises:
        StudyError: no cell on the study's own datasets is done.
        ResultsError: results do not belong together.
    """
    done = tuple(cell for cell in cells if is_done(cell, folder_of(work, cell)))
    missing = {
        cell.name: failures.get(cell.name, "not run yet") for cell in cells if cell not in done
    }
    files = {cell.name: folder_of(work, cell) / DATA for cell in done}
    facts = {name: Facts.from_file(file) for name, file in files.items() if file.exists()}
    main = [cell for cell in done if is_main(study, cell)]
    if not any(cell.kind == "offline" for cell in main):
        raise StudyError(
            f"no cell of the study's datasets is done in {work}, so there is nothing to write"
        )
    part = [cell for cell in done if is_size(study, cell)]
    results, elsewhere = _matched(_gather(main, work, facts))
    return Findings(
        study=study,
        cells=done,
        missing={**missing, **elsewhere},
        results=results,
        sizes=_gather(part, work, facts) if part else None,
        facts=facts,
        costs={cell.name: Cost.from_file(folder_of(work, cell) / COST) for cell in done},
        work=work,
    )


def _matched(results: ResultSet) -> tuple[ResultSet, dict[str, str]]:
    """The results without online algorithms that were measured in another world than the data's."""
    specs = {case.spec.hash() for case in results.cases}
    same = tuple(case for case in results.baselines if case.spec.hash() in specs)
    others = {
        label: f"it learned in spec {case.spec.hash()[:12]}, which is that of no dataset here"
        for case in results.baselines
        if case not in same
        for label in case.runs
    }
    return replace(results, baselines=same), others


def is_main(study: Study, cell: Cell) -> bool:
    """Whether a cell is in the study's grid, or online: not of a size or a view."""
    if cell.kind != "offline":
        return True
    return cell.data in {named(dataset) for dataset in study.datasets}


def is_size(study: Study, cell: Cell) -> bool:
    """Whether a cell is a point of the data efficiency."""
    if study.sizes is None or cell.label not in study.sizes.algorithms or "~" in cell.data:
        return False
    wanted = [sized(d, size) for d in study.sizes.datasets for size in study.sizes.sizes]
    return (cell.source, cell.n_steps) in wanted


def _gather(cells: Sequence[Cell], work: Path, facts: Mapping[str, Facts]) -> ResultSet:
    found, known = gather(results_of(cells, work)), by_id(facts)
    return replace(found, cases=tuple(_with_data(case, known) for case in found.cases))


def by_id(facts: Mapping[str, Facts]) -> dict[str, Facts]:
    """Facts by dataset, of those of its cells."""
    return {each.id: each for each in facts.values()}


def results_of(cells: Sequence[Cell], work: Path) -> list[Result]:
    """All results of cells that are done."""
    folders = [folder_of(work, cell) / RESULTS for cell in cells]
    return [load_result(file) for folder in folders for file in sorted(folder.glob("*.json"))]


def _with_data(case: Case, facts: Mapping[str, Facts]) -> Case:
    """The case with the figures of its own episodes, which a cell has read."""
    known = facts.get(str(case.dataset).partition("@")[0])  # a view's own episodes are the same
    return case if known is None else replace(case, data=known.figures)
