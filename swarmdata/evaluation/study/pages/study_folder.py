"""Writes a study's folder: CSV tables, figures, and a page whose sentences are computed."""

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.cards.committed_studies import ESTIMATES_FILE, PLAN_FILE
from swarmdata.evaluation.figures.dot_plot import plot_by_dataset
from swarmdata.evaluation.results.aggregates import comparable_scores
from swarmdata.evaluation.results.result_plots import plot_differences, plot_score_profiles
from swarmdata.evaluation.results.result_tables import aggregate_table, words_of_weights
from swarmdata.evaluation.runs.portable_names import without_folders, without_places
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.cell_archive import (
    ARCHIVE_FILE,
    Notes,
    check_archive,
    read_archive,
    write_archive,
)
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.csv_tables import (
    cost_rows,
    curve_rows,
    dataset_rows,
    estimate_rows,
    run_rows,
    to_csv,
)
from swarmdata.evaluation.study.pages.data_efficiency_section import size_section
from swarmdata.evaluation.study.pages.differences_section import differences_sections
from swarmdata.evaluation.study.pages.information_section import information_section
from swarmdata.evaluation.study.pages.safety_section import (
    MAX_ALGORITHMS_IN_MATRIX,
    safety_sections,
)
from swarmdata.evaluation.study.pages.scoreboard import (
    Scoreboard,
    make_scoreboard,
    quantity_of,
)
from swarmdata.evaluation.study.pages.study_tables import (
    cost_table,
    duration,
    online_table,
    scoreboard_table,
    training_table,
)
from swarmdata.evaluation.study.pages.training_sections import curve_section, loss_sections
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.shifts.shift_sections import task_section, transfer_section
from swarmdata.evaluation.study.shifts.shift_table import (
    TASKS_FILE,
    TRANSFER_FILE,
    Shifted,
    read_shifts,
    write_shifts,
)
from swarmdata.rollouts.score_intervals import target_of
from swarmdata.runtime.output_folder import OutputKind, filled, listed_files
from swarmdata.specs.plain_names import without_version
from swarmdata.store import write_file
from swarmdata.types import Double

STUDY = OutputKind("study")

REPORT_FILE = "report.md"
RESULTS_FILE = "results.csv"
DATA_FILE = "data.csv"
COSTS_FILE = "costs.csv"
CURVES_FILE = "curves.csv"

BLOCK_NAMES = {"evaluation": "reserved", "validation": "validation"}
"""What texts call the seeds of a block."""


@dataclass(frozen=True)
class Section:
    """One section of the page."""

    title: str
    body: str

    def to_markdown(self) -> str:
        """The section with its heading."""
        return f"\n## {self.title}\n\n{self.body.rstrip()}\n"


def write_pages(
    found: Findings,
    out: Path,
    command: str,
    sweeps: Mapping[str, str] | None = None,
    shifts: Mapping[str, Sequence[Shifted]] | None = None,
) -> list[Path]:
    """Writes tables of what was measured, the archive and, from it, estimates, page and figures.

    Args:
        found: what was measured.
        out: folder; files that a study wrote there are replaced.
        command: that runs the study again, for the page.
        sweeps: sections on sweeps by title, whose files are in `out` already.
        shifts: what policies reach in other views and tasks, by the name of the file.

    Returns:
        The files, the page first.

    Raises:
        OutputError: the folder has files that no study wrote.
        MissingExtraError: matplotlib is not installed.
    """
    missing = {name: without_folders(reason) for name, reason in found.missing.items()}
    notes = Notes(command=without_folders(command), missing=missing, sweeps=dict(sweeps or {}))
    with filled(out, STUDY) as folder:
        tables = {
            RESULTS_FILE: run_rows,
            DATA_FILE: dataset_rows,
            COSTS_FILE: cost_rows,
            CURVES_FILE: curve_rows,
        }
        for name, rows_of in tables.items():
            write_file(folder / name, to_csv(rows_of(found)).encode())
        plan = Study.parse(without_places(found.study.model_dump(mode="json")), PLAN_FILE)
        write_file(folder / PLAN_FILE, plan.to_yaml().encode())
        for name, rows in (shifts or {}).items():
            write_shifts(rows, folder / name)
        write_archive(found, notes, folder / ARCHIVE_FILE)
        files = _write_from_archive(folder, out)
    for name in listed_files(out, STUDY).intersection(shifts or {}):
        if out / name not in files:  # of an earlier plan, or of results that are gone
            (out / name).unlink(missing_ok=True)
    return files


def rewrite_pages(out: Path) -> list[Path]:
    """Writes estimates, page and figures of a finished study again, from its folder alone.

    What policies reach in other conditions is not computed again: the archive does not have these
    episodes, but the text on sweeps, and the folder has the estimates.

    Args:
        out: folder that `write_pages` wrote.

    Returns:
        The files, the page first.

    Raises:
        StudyError: the folder has no archive of cells.
        MissingExtraError: matplotlib is not installed.
    """
    check_archive(out / ARCHIVE_FILE)
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
        write_file(folder / ESTIMATES_FILE, to_csv(estimate_rows(found)).encode())
        page = _page(found, folder, notes.command, notes.sweeps)
        write_file(folder / REPORT_FILE, page.encode())
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return [out / REPORT_FILE, *(out / file for file in files if file != Path(REPORT_FILE))]


def _page(found: Findings, out: Path, command: str, sweeps: Mapping[str, str]) -> str:
    key = quantity_of(found.results).column.key
    board, clean = (
        make_scoreboard(found.results, found.families, each) for each in (key, "clean_success")
    )
    best = study_text.winners(board) + study_text.families(board)
    surprises = study_text.surprises(board, clean, _online_values(found, key))
    sections = [
        Section("Protocol", _protocol(found, command)),
        Section("Best algorithms", _bullets(best)),
        Section(board.column.label.capitalize(), _scores(found, board, out, key)),
        *_online(found),
        Section("Comparison with the data", _against_data(board)),
        *(Section(*part) for part in safety_sections(found, out).items()),
        *_overall(found, out),
        *(Section(*part) for part in [*_optional(found, out), *sweeps.items()]),
        *(Section(*part) for part in _shifted(found, out)),
        Section("Surprises", _bullets(surprises)),
        Section("Failures", _bullets(study_text.failures(board, found.missing))),
        Section("Cost", cost_table(found)),
    ]
    title = found.study.title or f"Study {found.study.name}"
    return f"# {title}\n" + "".join(section.to_markdown() for section in sections)


def _shifted(found: Findings, out: Path) -> list[tuple[str, str]]:
    """The sections on other views and tasks, from the estimates in the folder."""
    transfers = transfer_section(found, read_shifts(out / TRANSFER_FILE))
    return [*transfers.items(), *task_section(found, read_shifts(out / TASKS_FILE)).items()]


def _bullets(sentences: Sequence[str]) -> str:
    return "".join(f"- {sentence}\n" for sentence in sentences) or "None.\n"


def _protocol(found: Findings, command: str) -> str:
    study, costs = found.study, list(found.costs.values())
    offline = [cell for cell in found.cells if cell.kind == "offline"]
    n_seeds = [len(cell.seeds) for cell in offline]
    versions = sorted({cell.code_version for cell in found.cells})
    machines = sorted({str(cost.machine.get("processor", "unknown")) for cost in costs})
    cpu = duration(sum(cost.cpu_seconds for cost in costs))
    total = sum(cost.wall_seconds for cost in costs)
    n_datasets = len(study.datasets)
    where = "one dataset" if n_datasets == 1 else f"{n_datasets} datasets"
    names = ", ".join(f"`{name}` {value}" for name, value in study.settings.items())
    shared = f"Settings of all algorithms that have them: {names}. " if names else ""
    return (
        f"{len(study.algorithms)} offline algorithms on {where}, {len(study.seeds)} training seeds "
        f"each, the same settings of an algorithm on all datasets. {shared}The last policy of each "
        f"seed is evaluated on the same {study.episodes:,} {BLOCK_NAMES[study.block]} seeds. "
        f"Numbers are means over seeds and episodes with 95 % intervals for {target_of(n_seeds)} "
        "(Student's t, with the variance between seeds and that which all seeds share on an "
        "episode); differences between algorithms are paired by episode. The mean of the data is "
        f"that of its own episodes, with action noise. {_mixtures(found)}{_rewards(found)}"
        f"{len(found.cells)} cells were run with swarmdata {', '.join(versions)} in {cpu} of "
        f"processor time and {duration(total)} of wall-clock time, one thread per process, on "
        f"{', '.join(machines)}.\n\n"
        f"```\n{command}\n```\n\n"
        "Lengths of training (an epoch is as many joint transitions as the training split has):\n\n"
        f"{training_table(found)}\n{_links()}"
    )


def _mixtures(found: Findings) -> str:
    """What was mixed, and how it is called in tables; empty: nothing."""
    mixed = [cell for cell in found.cells if cell.parts and cell.name in found.facts]
    as_recorded = [cell for cell in mixed if not (cell.observation or cell.communication)]
    names = {cell.source: found.facts[cell.name].id for cell in as_recorded}
    mixtures = [
        f"`{names[mixture]}` is the mixture `{mixture}`: "
        + ", ".join(f"{weight:g} of `{short_name(part)}`" for part, weight in parts.items())
        for mixture, parts in found.study.mixtures.items()
        if mixture in names
    ]
    return f"Rows of batches are drawn by weight: {'; '.join(mixtures)}. " if mixtures else ""


def _rewards(found: Findings) -> str:
    """Which rows learned from other rewards than they are scored by; empty: none did."""
    weights = [
        f"`{label}` on {without_version(case.name)} with {words_of_weights(rewards)}"
        for case in found.results.cases
        for label, rewards in case.rewards.items()
    ]
    if not weights:
        return ""
    return (
        f"Some rows learned from rewards with other weights: {'; '.join(weights)}. Scores and "
        "returns of all rows are of the task's own rewards. "
    )


def _links() -> str:
    """What the other files of the folder have."""
    files = {
        RESULTS_FILE: "a row for every run",
        ESTIMATES_FILE: "every mean with its interval",
        DATA_FILE: "a row for every dataset",
        COSTS_FILE: "a row for every cell",
        PLAN_FILE: "the plan of the study",
        ARCHIVE_FILE: "the episodes, from which `swarmdata study FOLDER` writes this page again",
    }
    return "".join(f"- [{name}]({name}): {what}\n" for name, what in files.items())


def _scores(found: Findings, board: Scoreboard, out: Path, key: str) -> str:
    scale = {
        "score": "0 is the better of an idle and a random team, 100 the expert.",
        "return": "Team return; this world has no measured expert.",
    }[key]
    shown = {without_version(name): board.in_shown_units(name) for name in board.estimates}
    data_means = {
        without_version(name): board.column.factor * value for name, value in board.data.items()
    }
    plot_by_dataset(
        shown,
        data_means,
        found.looks,
        out / "scores.png",
        label=board.column.label,
        families=board.families,
        shares_axis=key == "score",
    )
    return (
        f"{scale} Bold: the best algorithm of a dataset, and those whose difference to it, paired "
        f"by episode, is not clearly below 0.\n\n{scoreboard_table(board)}\n"
        f"![{board.column.label} by dataset](scores.png)\n"
    )


def _against_data(board: Scoreboard) -> str:
    """The section on what the data themselves achieve."""
    return (
        "The mean of the data is that of all episodes of a dataset, action noise included: a known "
        "number, from other episodes than the evaluation's. So nothing is paired, and only the "
        "interval of the algorithm counts.\n\n"
        f"{_bullets(study_text.against_data(board))}"
    )


def _online(found: Findings) -> list[Section]:
    table = online_table(found.results.baselines)
    return [Section("Online algorithms", table)] if table else []


def _online_values(found: Findings, key: str) -> dict[str, dict[str, Double]]:
    """The main quantity of the online algorithms in the world of each dataset."""
    results, quantity = found.results, quantity_of(found.results)
    values: dict[str, dict[str, Double]] = {}
    for case in results.cases:
        both = results.with_baselines(case)
        known = key != "score" or case.reference is not None
        labels = [label for label in both.runs if label not in case.runs] if known else []
        values[case.name] = {label: quantity.values(both, label) for label in labels}
    return values


def _overall(found: Findings, out: Path) -> list[Section]:
    """Aggregates of the algorithms that have results on all datasets."""
    results = found.results
    tables = comparable_scores(results).tables
    if len(tables) < 2 or len(results.cases) < 2:
        return []
    body = aggregate_table(results).to_markdown()
    plot_score_profiles(tables, found.looks, out / "profiles.png")
    body += "\n![share of runs above a score](profiles.png)\n"
    if 2 < len(tables) <= MAX_ALGORITHMS_IN_MATRIX:  # of two, the table has the one difference
        plot_differences(tables, out / "differences.png")
        body += "\n![paired differences of scores](differences.png)\n"
    return [Section("Aggregates over datasets", body)]


def _optional(found: Findings, out: Path) -> list[tuple[str, str]]:
    """The sections that a study may ask for, by title."""
    writers = (
        differences_sections,
        size_section,
        information_section,
        curve_section,
        loss_sections,
    )
    return [section for write in writers for section in write(found, out).items()]
