"""Writes a study's folder: CSV tables, figures, and a page whose sentences are computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata import __version__
from swarmdata.evaluation.results.aggregates import comparable_scores
from swarmdata.evaluation.results.result_plots import plot_improvements, plot_pareto, plot_profiles
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import aggregate_table
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.csv_tables import (
    cost_rows,
    curve_rows,
    dataset_rows,
    run_rows,
    to_csv,
)
from swarmdata.evaluation.study.pages.data_efficiency_section import size_section
from swarmdata.evaluation.study.pages.information_section import information_section
from swarmdata.evaluation.study.pages.scoreboard import (
    Scoreboard,
    make_scoreboard,
    quantity_of,
)
from swarmdata.evaluation.study.pages.study_figures import plot_scores, plot_two_estimates
from swarmdata.evaluation.study.pages.study_tables import (
    cost_table,
    duration,
    online_table,
    scoreboard_table,
)
from swarmdata.evaluation.study.pages.training_sections import curve_section, loss_sections
from swarmdata.runtime.locking import updating
from swarmdata.specs.plain_names import without_version
from swarmdata.store import write_file

REPORT_FILE = "report.md"
RESULTS_FILE = "results.csv"
DATA_FILE = "data.csv"
COSTS_FILE = "costs.csv"
CURVES_FILE = "curves.csv"
PLAN_FILE = "study.yaml"

BLOCK_NAMES = {"evaluation": "reserved", "validation": "validation"}
"""What texts call the seeds of a block."""

MAX_ALGORITHMS_IN_FIGURE = 24
"""Algorithms whose names fit beside a figure; with more, those figures are left out."""


@dataclass(frozen=True)
class Section:
    """One section of the page."""

    title: str
    body: str

    def to_markdown(self) -> str:
        """The section with its heading."""
        return f"\n## {self.title}\n\n{self.body.rstrip()}\n"


def write_pages(
    found: Findings, out: Path, command: str, sweeps: Mapping[str, str] | None = None
) -> list[Path]:
    """Writes the tables, the page, and the figures that the study asks for.

    Args:
        found: what was measured.
        out: folder; existing files are replaced.
        command: that runs the study again, for the page.
        sweeps: sections on robustness by title, whose files are in `out` already.

    Returns:
        The files, the page first.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with updating(out / REPORT_FILE):  # the files belong together
        return _write_files(found, out, command, sweeps or {})


def _write_files(found: Findings, out: Path, command: str, sweeps: Mapping[str, str]) -> list[Path]:
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    tables = {
        RESULTS_FILE: run_rows,
        DATA_FILE: dataset_rows,
        COSTS_FILE: cost_rows,
        CURVES_FILE: curve_rows,
    }
    for name, rows_of in tables.items():
        write_file(out / name, to_csv(rows_of(found)).encode())
    write_file(out / PLAN_FILE, found.study.to_yaml().encode())
    page = _page(found, out, command, sweeps)
    write_file(out / REPORT_FILE, page.encode())
    files = [path for path in sorted(out.rglob("[!.]*")) if path.is_file()]
    changed = [path for path in files if before.get(path) != path.stat().st_mtime_ns]
    return [out / REPORT_FILE, *(path for path in changed if path != out / REPORT_FILE)]


def _page(found: Findings, out: Path, command: str, sweeps: Mapping[str, str]) -> str:
    families = {label: each.family for label, each in found.study.algorithms.items()}
    key = quantity_of(found.results).column.key
    board, clean, success = (
        make_scoreboard(found.results, families, each) for each in (key, "clean_success", "success")
    )
    best = study_text.winners(board) + study_text.families(board)
    surprises = study_text.surprises(board, clean, _online_means(found, key))
    sections = [
        Section("Protocol", _protocol(found, command)),
        Section("Best algorithms", _bullets(best)),
        Section(board.column.label.capitalize(), _scores(board, out, key)),
        *_online(found),
        Section("Comparison with the data", _bullets(study_text.against_data(board))),
        Section("Success", _success(board, success, clean, out)),
        *_pareto(found.results, out),
        *_overall(found.results, out),
        *(Section(*part) for part in [*_optional(found, out), *sweeps.items()]),
        Section("Surprises", _bullets(surprises)),
        Section("Failures", _bullets(study_text.failures(board, found.missing))),
        Section("Cost", cost_table(found)),
    ]
    title = found.study.title or f"Study {found.study.name}"
    return f"# {title}\n" + "".join(section.to_markdown() for section in sections)


def _bullets(sentences: Sequence[str]) -> str:
    return "".join(f"- {sentence}\n" for sentence in sentences) or "None.\n"


def _protocol(found: Findings, command: str) -> str:
    study, costs = found.study, list(found.costs.values())
    offline = [cell for cell in found.cells if cell.kind == "offline"]
    updates = sorted({cell.n_updates for cell in offline})
    machines = sorted({str(cost.machine.get("processor", "unknown")) for cost in costs})
    cpu = duration(sum(cost.cpu_seconds for cost in costs))
    total = sum(cost.wall_seconds for cost in costs)
    n_datasets = len(study.datasets)
    where = "one dataset" if n_datasets == 1 else f"{n_datasets} datasets"
    width = f"Hidden layers of {list(study.hidden)} units. " if study.hidden else ""
    shared = ", ".join(f"`{name}` {value}" for name, value in study.settings.items())
    width += f"Settings of all algorithms that have them: {shared}. " if shared else ""
    return (
        f"{len(study.algorithms)} offline algorithms on {where}, "
        f"{len(study.seeds)} seeds each, {updates[0]:,} to {updates[-1]:,} updates, the same "
        f"settings of an algorithm on all datasets. {width}The last policy of every seed is "
        f"evaluated on the same {study.episodes:,} {BLOCK_NAMES[study.block]} seeds. "
        "Numbers are interquartile means over training seeds with 95 % stratified bootstrap "
        "intervals; the mean of the data is "
        f"that of its own episodes, with action noise. {len(found.cells)} cells were run with "
        f"swarmdata {__version__} in {cpu} of processor time and {duration(total)} of wall-clock "
        f"time, one thread per process, on {', '.join(machines)}.\n\n```\n{command}\n```\n\n"
        f"[{RESULTS_FILE}]({RESULTS_FILE}) has a row for every run, [{DATA_FILE}]({DATA_FILE}) for "
        f"every dataset, [{COSTS_FILE}]({COSTS_FILE}) for every cell; [{PLAN_FILE}]({PLAN_FILE}) "
        "is the plan of the study.\n"
    )


def _scores(board: Scoreboard, out: Path, key: str) -> str:
    scale = {
        "score": "0 is the better of an idle and a random team, 100 the expert.",
        "return": "Team return; this world has no measured expert.",
    }[key]
    shown = {without_version(name): board.in_shown_units(name) for name in board.estimates}
    data_means = {
        without_version(name): board.column.factor * value for name, value in board.data.items()
    }
    plot_scores(shown, data_means, board.families, out / "scores.png", label=board.column.label)
    return (
        f"{scale} Bold: the best algorithm of a dataset, and those whose intervals overlap its "
        f"interval.\n\n{scoreboard_table(board)}\n![{board.column.label} by dataset](scores.png)\n"
    )


def _online(found: Findings) -> list[Section]:
    table = online_table(found.results.baselines)
    return [Section("Online algorithms", table)] if table else []


def _online_means(found: Findings, key: str) -> dict[str, float]:
    """The main quantity of the online algorithms: means over all their runs."""
    quantity = quantity_of(found.results)
    return {
        label: float(quantity.values(case, label).mean())
        for case in found.results.baselines
        if key != "score" or case.reference is not None
        for label in case.runs
    }


def _success(board: Scoreboard, success: Scoreboard, clean: Scoreboard, out: Path) -> str:
    panels = {}
    for dataset in clean.estimates:
        if dataset in board.estimates:
            x, y = clean.in_shown_units(dataset), board.in_shown_units(dataset)
            panels[without_version(dataset)] = {k: (x[k], y[k]) for k in x if k in y}
    plot_two_estimates(
        panels, board.families, out / "clean.png",
        xlabel="clean success (%)", ylabel=board.column.label, xlim=(-3.0, 103.0),
    )  # fmt: skip
    return (
        f"Episodes solved (%):\n\n{scoreboard_table(success)}\n"
        f"Episodes solved without a collision (%):\n\n{scoreboard_table(clean)}\n"
        f"![{board.column.label} against clean success](clean.png)\n"
    )


def _pareto(results: ResultSet, out: Path) -> list[Section]:
    if len(results.labels) > MAX_ALGORITHMS_IN_FIGURE:
        return []
    plot_pareto(results.cases, out / "collisions.png")
    body = (
        "Filled points are Pareto-optimal on their dataset; the dashed line is the mean return of "
        "the data.\n\n![team return against collisions](collisions.png)\n"
    )
    return [Section("Return and collisions", body)]


def _overall(results: ResultSet, out: Path) -> list[Section]:
    """Aggregates of the algorithms that have results on all datasets."""
    tables = comparable_scores(results).tables
    if len(tables) < 2 or len(results.cases) < 2:
        return []
    body = aggregate_table(results).to_markdown()
    if len(tables) <= MAX_ALGORITHMS_IN_FIGURE:
        plot_profiles(tables, out / "profiles.png")
        plot_improvements(tables, out / "improvements.png")
        body += (
            "\n![share of runs above a score](profiles.png)\n\n"
            "![probability of improvement](improvements.png)\n"
        )
    return [Section("Aggregates over datasets", body)]


def _optional(found: Findings, out: Path) -> list[tuple[str, str]]:
    """The sections that a study may ask for, by title."""
    writers = (size_section, information_section, curve_section, loss_sections)
    return [section for write in writers for section in write(found, out).items()]
