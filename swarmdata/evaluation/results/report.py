"""The report of evaluation results: all tables and figures in one folder."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from swarmdata.drawing.style import SUFFIXES
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.aggregates import comparable_scores
from swarmdata.evaluation.results.estimate_table import Table
from swarmdata.evaluation.results.learning_curves import plot_curves, read_curve
from swarmdata.evaluation.results.result_exports import marl_eval, runs_csv
from swarmdata.evaluation.results.result_plots import (
    plot_differences,
    plot_estimates,
    plot_pareto,
    plot_result_scores,
    plot_score_profiles,
    result_looks,
)
from swarmdata.evaluation.results.result_set import Case, ResultSet, read_results, unique_names
from swarmdata.evaluation.results.result_tables import (
    aggregate_table,
    case_table,
    difference_table,
    score_table,
)
from swarmdata.learn.training.run_files import CURVE, run_folders, run_names
from swarmdata.runtime.output_folder import OutputKind, check_output, filled, remove_others

REPORT = OutputKind("report")

MAX_PANELS = 4  # columns of a table that its figure shows, from the left


def shown_cases(results: ResultSet) -> dict[str, Case]:
    """Returns all cases by file name: datasets with baselines, and specs with baselines only."""
    specs = {case.spec.hash() for case in results.cases}
    alone = [case for case in results.baselines if case.spec.hash() not in specs]
    cases = [results.with_baselines(case) for case in (*results.cases, *alone)]
    names = ["table"] if len(cases) == 1 else unique_names(cases)
    return dict(zip(names, cases, strict=True))


def tables_of(results: ResultSet) -> dict[str, Table]:
    """Returns all tables of a report by file name: comparisons of datasets, then each case."""
    compared = comparable_scores(results).tables
    tables = {"scores": score_table(results)} if any(results.scores.values()) else {}
    if compared:
        tables["aggregates"] = aggregate_table(results)
    if len(compared) > 1:
        tables["differences"] = difference_table(results)
    return tables | {name: case_table(case) for name, case in shown_cases(results).items()}


def write_report(
    folders: Sequence[Path],
    out: Path,
    *,
    runs: Sequence[Path] = (),
    data: Sequence[Path] = (),
    suffix: str = ".png",
) -> str:
    """Writes tables (Markdown, CSV, LaTeX), figures, `runs.csv` and `marl-eval.json`.

    `report.md` has all tables and figures. `folders` have result files, as `evaluate` saves them;
    learning curves of `runs` are drawn in one figure; `data` is as `read_results` takes it;
    `suffix`, of figures, is `.png`, `.svg` or `.pdf`. Returns the tables as text. Without
    matplotlib, they are written, and MissingExtraError is raised.
    """
    if suffix not in SUFFIXES:
        raise SchemaError(f"cannot draw figures as {suffix!r}, expected one of {SUFFIXES}.")
    check_output(out, REPORT)
    results = read_results(folders, data=data)
    tables = tables_of(results)
    with filled(out, REPORT) as folder:
        left_out = _write_tables(results, tables, folder)
        kept = {path.name for path in folder.iterdir()}
    with filled(out, REPORT) as folder:  # apart, so that tables stay if figures cannot be drawn
        figures = _draw(results, tables, folder, suffix)
        if runs:
            figures["curves"] = _draw_curves(runs, results, folder / f"curves{suffix}")
        left = f"Not in marl-eval.json: {', '.join(left_out)}." if left_out else ""
        (folder / "report.md").write_text(_page(tables, figures, left), encoding="utf-8")
        kept |= {path.name for path in folder.iterdir()}
    remove_others(out, REPORT, kept)
    return "\n".join(f"{name}\n{table.to_text()}" for name, table in tables.items())


def _write_tables(results: ResultSet, tables: Mapping[str, Table], out: Path) -> Sequence[str]:
    """Writes tables and exports; returns what is not in `marl-eval.json`."""
    for name, table in tables.items():
        forms = {".md": table.to_markdown, ".csv": table.to_csv, ".tex": table.to_latex}
        for ending, form in forms.items():
            (out / f"{name}{ending}").write_text(form(), encoding="utf-8")
    document, left_out = marl_eval(results)
    text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    (out / "marl-eval.json").write_text(f"{text}\n", encoding="utf-8")
    (out / "runs.csv").write_text(runs_csv(results), encoding="utf-8")
    return left_out


def _draw(
    results: ResultSet, tables: Mapping[str, Table], out: Path, suffix: str
) -> dict[str, Path]:
    """Draws the figures that the results allow; returns them by name."""
    compared, cases = comparable_scores(results).tables, shown_cases(results)
    ours = [case for case in cases.values() if case.spec.world is not None]
    drawings: dict[str, Callable[[Path], None]] = {}
    if "scores" in tables:
        drawings["scores"] = partial(plot_result_scores, results)
    looks = result_looks(results)
    if compared:
        drawings["profile"] = partial(plot_score_profiles, compared, looks)
    if len(compared) > 2:  # of two, the table has the one difference
        drawings["differences"] = partial(plot_differences, compared)
    if ours:
        drawings["pareto"] = partial(plot_pareto, ours, looks=looks)
    for name in cases:
        keys = [column.key for column in tables[name].columns][:MAX_PANELS]
        drawings[name] = partial(plot_estimates, tables[name].panels(keys), looks=looks)
    for name, draw in drawings.items():
        draw(out / f"{name}{suffix}")
    return {name: out / f"{name}{suffix}" for name in drawings}


def _draw_curves(runs: Sequence[Path], results: ResultSet, path: Path) -> Path:
    curves = {
        name: read_curve(
            [part / CURVE for part in run_folders(run) or (run,)], "success", progress="update"
        )
        for name, run in zip(run_names(runs), runs, strict=True)
    }
    data = [case.data.success for case in results.cases if case.data is not None]
    references = {"mean of the data": data[0]} if len(data) == 1 else {}  # of one dataset
    looks, label = result_looks(results), "team success (%)"
    plot_curves(curves, path, ylabel=label, factor=100.0, looks=looks, references=references)
    return path


def _page(tables: Mapping[str, Table], figures: Mapping[str, Path], note: str) -> str:
    """The page: tables with their figures, then figures without a table."""
    parts = ["# Report\n"]
    for name in dict.fromkeys([*tables, *figures]):
        parts.append(f"## {name}\n")
        if name in tables:
            parts.append(tables[name].to_markdown())
        if name in figures:
            parts.append(f"![{name}]({figures[name].name})\n")
    return "\n".join([*parts, f"{note}\n" if note else ""]).rstrip() + "\n"
