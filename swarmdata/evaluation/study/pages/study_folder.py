"""Writes a study's folder: CSV tables, figures, and a page of tables and figures."""

import math
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.cards.committed_studies import ESTIMATES_FILE, PLAN_FILE
from swarmdata.drawing import markdown
from swarmdata.errors import StudyError
from swarmdata.evaluation.figures.dot_plot import (
    MAX_PANELS_IN_A_LINE,
    fits_on_a_screen,
    plot_by_dataset,
)
from swarmdata.evaluation.results.aggregates import (
    comparable_scores,
    differences,
    mean_over_datasets,
    probability_of_improvement,
)
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.results.result_plots import plot_differences, plot_score_profiles
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import aggregate_table
from swarmdata.evaluation.robustness.sweep_tables import Degradation
from swarmdata.evaluation.runs.portable_names import without_folders, without_places
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.cell_archive import (
    ARCHIVE_FILE,
    Notes,
    read_archive,
    write_archive,
)
from swarmdata.evaluation.study.pages.collect_results import Findings, is_in_grid
from swarmdata.evaluation.study.pages.data_views import information_section, size_section, view_rows
from swarmdata.evaluation.study.pages.row_differences import (
    difference_rows,
    differences_sections,
    distance_table,
)
from swarmdata.evaluation.study.pages.safety import MAX_ALGORITHMS_IN_MATRIX, safety_sections
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard, plot_beside_data
from swarmdata.evaluation.study.pages.study_tables import (
    cost_rows,
    cost_table,
    curve_rows,
    dataset_rows,
    duration,
    estimate_rows,
    online_table,
    run_rows,
    scoreboard_table,
    training_table,
)
from swarmdata.evaluation.study.pages.training_curves import (
    curve_section,
    loss_sections,
    online_curve_section,
)
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.shifts.shift import (
    TASKS_FILE,
    TRANSFER_FILE,
    Shifted,
    read_shifts,
    task_section,
    transfer_section,
    write_shifts,
)
from swarmdata.evaluation.study.shifts.sweeps import read_sweeps, sweep_sections, sweep_table
from swarmdata.rollouts.score_intervals import target_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.runtime.output_folder import OutputKind, filled, remove_others
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.rules import words_of_rewards
from swarmdata.store import write_file

MADE = "<!-- What follows is made by swarmdata; what stands above this line is kept. -->"

STUDY = OutputKind("study")

REPORT_FILE = "report.md"
TABLES = {
    "results.csv": run_rows,
    "data.csv": dataset_rows,
    "costs.csv": cost_rows,
    "curves.csv": curve_rows,
}

BLOCK_NAMES = {"evaluation": "reserved", "validation": "validation"}

DATA_CAPTION = (
    "The mean of the data is that of all episodes of a dataset, action noise included: a known "
    "number, so only the difference to a clone of the data, if the study has one, is paired by "
    "episode. A difference is higher or lower if its whole interval is."
)

LINKS = """- [results.csv](results.csv): a row for every run
- [estimates.csv](estimates.csv): every mean with its interval
- [data.csv](data.csv): a row for every dataset
- [costs.csv](costs.csv): a row for every cell
- [study.yaml](study.yaml): the plan of the study
- [cells.tar.xz](cells.tar.xz): the episodes, from which `swarmdata study FOLDER` writes this page \
again
"""


def write_pages(
    found: Findings, out: Path, command: str, shifts: Mapping[str, Sequence[Shifted]]
) -> list[Path]:
    """Writes tables of what was measured, the archive and, from it, estimates, page and figures.

    The page has the command that runs the study again. `shifts` is what policies reach in other
    views and tasks, by the name of the file. Returns the files, the page first.

    Raises:
        OutputError: the folder has files that no study wrote.
    """
    missing = {name: without_folders(reason) for name, reason in found.missing.items()}
    notes = Notes(command=without_folders(command), missing=missing)
    with filled(out, STUDY) as folder:
        for name, rows_of in TABLES.items():
            write_file(folder / name, to_csv(rows_of(found)).encode())
        plan = Study.parse(without_places(found.study.model_dump(mode="json")), PLAN_FILE)
        write_file(folder / PLAN_FILE, plan.to_yaml().encode())
        for name, rows in shifts.items():
            write_shifts(rows, folder / name)
        write_archive(found, notes, folder / ARCHIVE_FILE)
        files = _write_from_archive(folder, out)
    sweeps = {sweep_table(label) for label in found.study.sweeps}
    remove_others(out, STUDY, sweeps.union(file.relative_to(out).as_posix() for file in files))
    return files


def rewrite_pages(out: Path) -> list[Path]:
    """Writes estimates, page and figures of a finished study again, from its folder alone.

    What policies reach in other conditions is not computed again: the archive does not have these
    episodes, and the folder has the estimates. Returns the files, the page first.
    """
    if not (out / ARCHIVE_FILE).exists():
        raise StudyError(
            f"{out} has no {ARCHIVE_FILE}, from which its pages could be written again: it is not "
            "the folder of a study, or an older version wrote it. Run the study from its plan."
        )
    with filled(out, STUDY) as folder:
        for name in (PLAN_FILE, ARCHIVE_FILE, TRANSFER_FILE, TASKS_FILE):
            if (out / name).exists():
                shutil.copyfile(out / name, folder / name)
        return _write_from_archive(folder, out)


def _write_from_archive(folder: Path, out: Path) -> list[Path]:
    """Writes what the archive in a folder gives, and returns where all files will be in `out`."""
    study = Study.from_file(folder / PLAN_FILE)
    with tempfile.TemporaryDirectory() as unpacked:
        found, notes = read_archive(study, folder / ARCHIVE_FILE, Path(unpacked))
        tables: dict[str, Sequence[Mapping[str, object]]] = {
            ESTIMATES_FILE: estimate_rows(found),
            "differences.csv": difference_rows(found),
            "core.csv": _core_rows(found),
            "views.csv": view_rows(found),
        }
        for name, rows in tables.items():
            if rows:
                write_file(folder / name, to_csv(rows).encode())
        made = _made(found, folder, notes.command, read_sweeps(study, out))
        page = page_with(made, out / REPORT_FILE, study.title or f"Study {study.name}")
        write_file(folder / REPORT_FILE, page.encode())
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return [out / REPORT_FILE, *(out / file for file in files if file != Path(REPORT_FILE))]


def _made(found: Findings, out: Path, command: str, sweeps: Mapping[str, Degradation]) -> str:
    online, missing = online_table(found.results.baselines), list(found.missing.items())
    sections = [
        ("Protocol", _protocol(found, command)),
        (found.main.column.label.capitalize(), _scores(found, out)),
        ("Online algorithms", online),
        ("Comparison with the data", f"{DATA_CAPTION}\n\n{distance_table(found)}"),
        *safety_sections(found, out).items(),
        *_aggregate_sections(found, out).items(),
        *differences_sections(found, out),
        *size_section(found, out).items(),
        *information_section(found, out).items(),
        *curve_section(found, out).items(),
        *online_curve_section(found, out).items(),
        *loss_sections(found, out),
        *sweep_sections(found.study, sweeps, found.looks, out),
        *transfer_section(found, read_shifts(out / TRANSFER_FILE)).items(),
        *task_section(found, read_shifts(out / TASKS_FILE), out).items(),
        ("Without results", markdown.table(("cell", "reason"), missing) if missing else ""),
        ("Cost", cost_table(found)),
    ]
    return "\n".join(f"## {title}\n\n{body.rstrip()}\n" for title, body in sections if body)


def _protocol(found: Findings, command: str) -> str:
    """The facts of the study in a table, what was mixed and rewarded, the command, the files."""
    study, costs = found.study, list(found.costs.values())
    n_seeds = [len(cell.seeds) for cell in found.cells if cell.kind == "offline"]
    facts = {
        "offline algorithms": f"{len(study.algorithms)}",
        "datasets": f"{len(study.datasets)}",
        "training seeds": " or ".join(f"{n}" for n in sorted({*n_seeds})),
        "settings of all algorithms": ", ".join(f"`{k}` {v}" for k, v in study.settings.items()),
        "evaluation": f"{study.episodes:,} {BLOCK_NAMES[study.block]} seeds, last policies",
        "cells": f"{len(found.cells)}",
        "swarmdata": ", ".join(sorted({cell.code_version for cell in found.cells})),
        "processor time": duration(sum(cost.cpu_seconds for cost in costs)),
        "wall-clock time, one thread": duration(sum(cost.wall_seconds for cost in costs)),
        "machines": ", ".join(sorted({str(c.machine.get("processor", "unknown")) for c in costs})),
    }
    table = markdown.table(("property", "value"), [item for item in facts.items() if item[1]])
    return (
        f"{table}\nNumbers are means over seeds and episodes with 95 % intervals for "
        f"{target_of(n_seeds)} (Student's t, with the variance between seeds and that which all "
        "seeds share on an episode); differences between algorithms are paired by episode.\n\n"
        f"{_mixtures(found)}{_rewards(found)}```\n{command}\n```\n\n"
        "Lengths of training (an epoch is as many joint transitions as the training split has):\n\n"
        f"{training_table(found)}\n{LINKS}"
    )


def _mixtures(found: Findings) -> str:
    """What was mixed, and how it is called in tables; empty: nothing."""
    mixed = [cell for cell in found.cells if cell.parts and is_in_grid(found.study, cell)]
    names = {cell.source: found.facts[cell.name].id for cell in mixed if cell.name in found.facts}
    rows = [
        (f"`{names[mixture]}`", f"`{mixture}`", f"`{short_name(part)}`", f"{weight:g}")
        for mixture, parts in found.study.mixtures.items()
        if mixture in names
        for part, weight in parts.items()
    ]
    head = ("dataset", "mixture", "drawn from", "weight")
    return f"{markdown.table(head, rows)}\n" if rows else ""


def _rewards(found: Findings) -> str:
    """Which rows learned from other rewards than they are scored by; empty: none did."""
    rows = [
        (f"`{label}`", without_version(case.name), words_of_rewards(rewards))
        for case in found.results.cases
        for label, rewards in case.rewards.items()
    ]
    head = ("row", "dataset", "weights it learned from; scores are of the task's own")
    return f"{markdown.table(head, rows)}\n" if rows else ""


def _scores(found: Findings, out: Path) -> str:
    board = found.main
    is_score = board.column.key == "score"
    scale = "Team return; this world has no measured expert."
    if is_score:
        scale = "0 is the better of an idle and a random team, 100 the expert."
    shown = {without_version(name): board.in_shown_units(name) for name in board.estimates}
    n_lines = math.ceil(len(shown) / MAX_PANELS_IN_A_LINE)
    is_known = board.data.keys() >= board.estimates.keys()
    if fits_on_a_screen(len(board.families), n_lines) or not is_known:
        plot_by_dataset(
            shown, board.shown_data, found.looks, out / "scores.png", label=board.column.label,
            families=board.families, shares_axis=is_score,
        )  # fmt: skip
    else:
        plot_beside_data(board, out / "scores.png")
    return (
        f"{scale} Bold: the best algorithm of a dataset, and those whose difference to it, paired "
        f"by episode, is not clearly below 0.\n\n{scoreboard_table(board)}\n"
        f"![{board.column.label} by dataset](scores.png)\n"
    )


def _aggregate_sections(found: Findings, out: Path) -> dict[str, str]:
    """The sections by title; none of fewer than two rows or datasets, none twice."""
    sections, results, core = {}, found.results, found.core
    profiles = "\n![share of runs above a score](profiles.png)\n"
    all_is_core = len(core.cases) == len(results.cases)
    if not all_is_core and (body := _aggregates(results, out / "differences.png", profiles)):
        plot_score_profiles(comparable_scores(results).tables, found.looks, out / "profiles.png")
        sections["Aggregates over datasets"] = body
    if body := _aggregates(core, out / "core-differences.png"):
        on_all = comparable_scores(core).tables
        families = {label: family for label, family in found.families.items() if label in on_all}
        plot_beside_data(make_scoreboard(core, families, "score"), out / "core.png")
        title = f"The core: {len(on_all)} rows on {len(core.cases)} datasets"
        sections[title] = f"![score by dataset](core.png)\n\n{body}"
    return sections


def _core_rows(found: Findings) -> list[dict[str, object]]:
    """The mean score over the core of each row that is on all of it, alone and minus each other."""
    tables = comparable_scores(found.core).tables
    runs = {label: table.mean(axis=-1) for label, table in tables.items()}

    def row(label: str, other: str, found: Estimate, improves: float | None) -> dict[str, object]:
        numbers = {"mean": found.value, "low": found.low, "high": found.high}
        return {"label": label, "minus": other, **numbers, "probability_of_improvement": improves}

    alone = [row(label, "", mean_over_datasets(table), None) for label, table in tables.items()]
    pairs = differences(tables).items()
    return alone + [
        row(one, other, found, probability_of_improvement(runs[one], runs[other]))
        for (one, other), found in pairs
    ]


def _aggregates(results: ResultSet, figure: Path, below: str = "") -> str:
    """Aggregates of the rows that are on all datasets, whose differences are drawn to a file.

    `below` is text for under the table. Empty if there are fewer than two rows or datasets.
    """
    tables = comparable_scores(results).tables
    if len(tables) < 2 or len(results.cases) < 2:
        return ""
    body = aggregate_table(results).to_markdown() + below
    if 2 < len(tables) <= MAX_ALGORITHMS_IN_MATRIX:  # of two, the table has the one difference
        plot_differences(tables, figure)
        body += f"\n![paired differences of scores]({figure.name})\n"
    return body


def page_with(made: str, file: Path, title: str) -> str:
    """Returns a page whose tables and figures are new, and whose text is that of the file.

    The file need not exist: then the page has a title. Without a line `MADE`, all of it is text.
    """
    old = file.read_text(encoding="utf-8") if file.exists() else f"# {title}\n"
    return f"{old.partition(MADE)[0].rstrip()}\n\n{MADE}\n\n{made.strip()}\n"
