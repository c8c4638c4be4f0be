"""Robustness: the best algorithm of each family under worse communication or sensing."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.robustness.sweep import sweep
from swarmdata.evaluation.robustness.sweep_axes import parse_axis
from swarmdata.evaluation.robustness.sweep_tables import Degradation, Line
from swarmdata.evaluation.study.cells.cell_worker import run_of
from swarmdata.evaluation.study.cells.cells import Cell, offline_cell
from swarmdata.evaluation.study.cells.run_cells import folder_of
from swarmdata.evaluation.study.cells.study_data import named
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import board_of, quantity_of, short
from swarmdata.evaluation.study.plan import Study, Sweep
from swarmdata.rollouts.score_statistics import Estimate

FOLDER = "sweeps"
"""Of results in the study's folder of cells, and of tables and figures beside its page."""


@dataclass(frozen=True)
class Swept:
    """One sweep of a study and the cells that it is about, one for each family."""

    label: str
    sweep: Sweep
    cells: tuple[Cell, ...]

    @property
    def key(self) -> str:
        """Hash of everything that decides the sweep's results."""
        content = [self.sweep.model_dump(mode="json"), [cell.key for cell in self.cells]]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def chosen_of(found: Findings, digest_of: Callable[[str], str]) -> list[Swept]:
    """What a study sweeps: the best of each family on the sweep's dataset, as measured there.

    Sweeps whose dataset has no results yet are left out.

    Args:
        found: what was measured.
        digest_of: the digest of a dataset by its id or folder.
    """
    families = {label: each.family for label, each in found.study.algorithms.items()}
    board = board_of(found.results, families, quantity_of(found.results).column.key)
    swept = []
    for label, wanted in found.study.sweeps.items():
        ids = {
            found.facts[cell.name].id
            for cell in found.cells
            if cell.kind == "offline" and cell.data == named(wanted.dataset)
        }
        for dataset in ids & board.estimates.keys():
            best = board.bests(dataset)
            names = wanted.families or found.study.families
            labels = [best[name] for name in names if name in best]
            cells = tuple(_cell(found.study, each, wanted, digest_of) for each in labels)
            swept.append(Swept(label, wanted, cells))
    return swept


def _cell(study: Study, label: str, wanted: Sweep, digest_of: Callable[[str], str]) -> Cell:
    return offline_cell(
        study,
        label,
        wanted.dataset,
        digest_of,
        observation=wanted.observation,
        communication=wanted.communication,
    )


def run_sweeps(
    swept: Sequence[Swept], work: Path, out: Path, *, progress: bool = True
) -> dict[str, str]:
    """Evaluates what is missing of the sweeps and puts tables and figures beside the page.

    Args:
        swept: sweeps whose cells are done.
        work: folder of the cells; a stopped sweep goes on there.
        out: folder of the page.
        progress: whether to show a bar for each.

    Returns:
        parts of the page, by title.
    """
    parts = {}
    for each in swept:
        wanted = each.sweep
        folder = work / FOLDER / f"{each.label}-{each.key[:12]}"
        names = [str(run_of(cell, folder_of(work, cell))) for cell in each.cells]
        axis = parse_axis(wanted.axis, wanted.vary, wanted.points)
        (found,) = sweep(names, [axis], folder, n_episodes=wanted.episodes, progress=progress)
        there = out / FOLDER / each.label
        there.mkdir(parents=True, exist_ok=True)
        picture = f"{axis.part}-{axis.name}.png"
        for name in ("sweep.csv", picture):
            shutil.copyfile(folder / name, there / name)
        parts[f"Robustness: {axis.parameter}"] = _body(
            each, found, f"{FOLDER}/{each.label}", picture
        )
    return parts


def _body(swept: Swept, found: Degradation, folder: str, picture: str) -> str:
    wanted = swept.sweep
    models = [
        f"{kind} `{model}`"
        for kind in ("observation", "communication")
        if (model := getattr(wanted, kind)) is not None
    ]
    trained = f" seen through {' and '.join(models)}" if models else ""
    lines = "".join(f"- {_sentence(line, found)}\n" for line in found.lines)
    return (
        f"The best of each family on {short(named(wanted.dataset))}, trained on it{trained}; "
        f"{wanted.episodes:,} evaluation seeds at each point, everything else as in training. "
        f"[Every number]({folder}/sweep.csv).\n\n![{found.part} {found.name}]({folder}/{picture})"
        f"\n\n{lines}"
    )


def _sentence(line: Line, found: Degradation) -> str:
    """What a team loses at the end of the axis."""
    column = found.columns[-1]  # the change since training
    last = line.on_axis[-1]
    change: Estimate = last.estimates[-1]
    return (
        f"`{line.label}` at {found.name} {last.value:g}: {column.label} "
        f"{format_estimate(change, column)}."
    )
