"""Writes a study's folder: tidy tables, figures, and a page whose sentences are computed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata import __version__
from swarmdata.evaluation.results.aggregate import complete
from swarmdata.evaluation.results.result_plots import plot_improvements, plot_pareto, plot_profiles
from swarmdata.evaluation.results.result_set import ResultSet
from swarmdata.evaluation.results.result_tables import aggregate_table
from swarmdata.evaluation.study.pages import study_text
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.csv_files import to_csv
from swarmdata.evaluation.study.pages.data_efficiency import size_section
from swarmdata.evaluation.study.pages.scoreboard import Board, board_of, quantity_of, short
from swarmdata.evaluation.study.pages.study_figures import plot_scores, plot_trade
from swarmdata.evaluation.study.pages.study_tables import (
    board_table,
    cost_table,
    duration,
    online_table,
)
from swarmdata.evaluation.study.pages.tidy_tables import cost_rows, data_rows, tidy_rows, track_rows
from swarmdata.evaluation.study.pages.training_tracks import curve_section, loss_sections
from swarmdata.runtime.locking import updating
from swarmdata.store import write_file

REPORT, RESULTS, DATA, COSTS, CURVES, FILE = (
    "report.md", "results.csv", "data.csv", "costs.csv", "curves.csv", "study.yaml",
)  # fmt: skip

CLEAN, SUCCESS = "clean_success", "success"

MOST_NAMED = 24
"""Algorithms whose names fit beside a figure; of more, those figures are left out."""


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    title: str
    body: str

    def to_markdown(self) -> str:
        """With its heading."""
        return f"\n## {self.title}\n\n{self.body.rstrip()}\n"


def write_pages(
    found: Findings, out: Path, command: str, sweeps: Mapping[str, str] | None = None
) -> list[Path]:
    """Writes everything of a study; figures of what was not asked for are left out.

    Args:
        found: what was measured.
        out: folder; files of an earlier writing are replaced.
        command: that does the study again, for the page.
        sweeps: parts on robustness by title, whose files are in `out` already.

    Returns:
        The files, the page first.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with updating(out / REPORT):  # the files belong together
        return _write(found, out, command, sweeps or {})


def _write(found: Findings, out: Path, command: str, sweeps: Mapping[str, str]) -> list[Path]:
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    tables = {RESULTS: tidy_rows, DATA: data_rows, COSTS: cost_rows, CURVES: track_rows}
    for name, rows_of in tables.items():
        write_file(out / name, to_csv(rows_of(found)).encode())
    write_file(out / FILE, found.study.to_yaml().encode())
    page = _page(found, out, command, sweeps)
    write_file(out / REPORT, page.encode())
    files = [path for path in sorted(out.rglob("[!.]*")) if path.is_file()]
    changed = [path for path in files if before.get(path) != path.stat().st_mtime_ns]
    return [out / REPORT, *(path for path in changed if path != out / REPORT)]


def _page(found: Findings, out: Path, command: str, sweeps: Mapping[str, str]) -> str:
    families = {label: each.family for label, each in found.study.algorithms.items()}
    key = quantity_of(found.results).column.key
    board, clean, success = (
        board_of(found.results, families, each) for each in (key, CLEAN, SUCCESS)
    )
    sections = [
        Section("What was done", _protocol(found, command)),
        Section("Who wins", _list(study_text.winners(board) + study_text.families(board))),
        Section(f"{board.column.label.capitalize()}", _scores(board, out, key)),
        *_online(found),
        Section("Beside the data", _list(study_text.against_data(board))),
        Section("Success", _success(board, success, clean, out)),
        *_pareto(found.results, out),
        *_overall(found.results, out),
        *(Section(*part) for part in [*_optional(found, out), *sweeps.items()]),
        Section("What surprised", _list(study_text.surprises(board, clean, _means(found, key)))),
        Section("What failed", _list(study_text.failures(board, found.missing))),
        Section("What it cost", cost_table(found)),
    ]
    title = found.study.title or f"Study {found.study.name}"
    return f"# {title}\n" + "".join(section.to_markdown() for section in sections)


def _list(sentences: Sequence[str]) -> str:
    return "".join(f"- {sentence}\n" for sentence in sentences) or "Nothing.\n"


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
    for_all = ", ".join(f"`{name}` {value}" for name, value in study.settings.items())
    width += f"Where an algorithm has them: {for_all}. " if for_all else ""
    return (
        f"{len(study.algorithms)} offline algorithms on {where}, "
        f"{len(study.seeds)} seeds each, {updates[0]:,} to {updates[-1]:,} updates, one setting of "
        f"an algorithm for all datasets. {width}The last policy of every seed is measured on the "
        f"same {study.episodes:,} reserved evaluation seeds. Numbers are interquartile means over "
        "training seeds with 95 % stratified bootstrap intervals; the data's mean is that of its "
        f"own episodes, action noise included. Done are {len(found.cells)} cells with swarmdata "
        f"{__version__}, in {cpu} of processor time and {duration(total)} of work, one thread a "
        f"process, on {', '.join(machines)}.\n\n```\n{command}\n```\n\n"
        f"Every run is a row of [{RESULTS}]({RESULTS}), every dataset of [{DATA}]({DATA}), every "
        f"cell's time of [{COSTS}]({COSTS}); [{FILE}]({FILE}) is the study.\n"
    )


def _scores(board: Board, out: Path, key: str) -> str:
    meaning = {
        "score": "0 is the better of an idle and a random team, 100 the expert.",
        "return": "Team return; this world has no measured expert.",
    }[key]
    shown = {short(name): board.shown(name) for name in board.estimates}
    own = {short(name): board.column.factor * value for name, value in board.data.items()}
    plot_scores(shown, own, board.families, out / "scores.png", label=f"{board.column.label}")
    return (
        f"{meaning} Bold: the best of a dataset, and those whose intervals reach into the best "
        f"one's.\n\n{board_table(board)}\n![{board.column.label} by dataset](scores.png)\n"
    )


def _online(found: Findings) -> list[Section]:
    table = online_table(found.results.baselines)
    return [Section("Online, in the task itself", table)] if table else []


def _means(found: Findings, key: str) -> dict[str, float]:
    """The main quantity of online algorithms: means over all their runs."""
    quantity = quantity_of(found.results)
    return {
        label: float(quantity.values(case, label).mean())
        for case in found.results.baselines
        if key != "score" or case.reference is not None
        for label in case.runs
    }


def _success(board: Board, success: Board, clean: Board, out: Path) -> str:
    panels = {}
    for dataset in clean.estimates:
        if dataset in board.estimates:
            tidy, main = clean.shown(dataset), board.shown(dataset)
            panels[short(dataset)] = {k: (tidy[k], main[k]) for k in tidy if k in main}
    plot_trade(
        panels, board.families, out / "clean.png",
        xlabel="clean success (%)", ylabel=board.column.label, xlim=(-3.0, 103.0),
    )  # fmt: skip
    return (
        f"Episodes solved (%):\n\n{board_table(success)}\n"
        f"Episodes solved without touching anything (%):\n\n{board_table(clean)}\n"
        f"![{board.column.label} against clean success](clean.png)\n"
    )


def _pareto(results: ResultSet, out: Path) -> list[Section]:
    if len(results.labels) > MOST_NAMED:
        return []
    plot_pareto(results.cases, out / "collisions.png")
    body = (
        "Filled points are beaten by none of their dataset in both; the dashed line is the return "
        "of the data.\n\n![team return against collisions](collisions.png)\n"
    )
    return [Section("Return and collisions", body)]


def _overall(results: ResultSet, out: Path) -> list[Section]:
    """Only of algorithms with results on all datasets: a mean over others is another quantity."""
    tables = complete(results).tables
    if len(tables) < 2 or len(results.cases) < 2:
        return []
    body = aggregate_table(results).to_markdown()
    if len(tables) <= MOST_NAMED:
        plot_profiles(tables, out / "profiles.png")
        plot_improvements(tables, out / "improvements.png")
        body += (
            "\n![share of runs above a score](profiles.png)\n\n"
            "![who beats whom](improvements.png)\n"
        )
    return [Section("Over all datasets", body)]


def _optional(found: Findings, out: Path) -> list[tuple[str, str]]:
    """Parts that a study may ask for."""
    parts: Mapping[str, Callable[[Findings, Path], Mapping[str, str]]] = {
        "sizes": size_section,
        "curves": curve_section,
        "losses": loss_sections,
    }
    return [pair for part in parts.values() for pair in part(found, out).items()]
