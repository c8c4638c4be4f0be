"""From result files and run folders to tables, pictures and animations on disk."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from swarmdata.behavior_policies.tiers import is_dataset
from swarmdata.datasets.reobservation import reobserved_episode
from swarmdata.drawing.style import SUFFIXES
from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.aggregate import complete
from swarmdata.evaluation.results.clips import check_clip, write_clip
from swarmdata.evaluation.results.curve_plots import plot_curves, plot_estimates, read_curve
from swarmdata.evaluation.results.estimate_table import Table
from swarmdata.evaluation.results.learning_curves import group_files, plot_learning
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_exports import marl_eval, runs_csv
from swarmdata.evaluation.results.result_plots import (
    plot_improvements,
    plot_pareto,
    plot_profiles,
    plot_scores,
)
from swarmdata.evaluation.results.result_set import Case, ResultSet, read_results
from swarmdata.evaluation.results.result_tables import (
    aggregate_table,
    case_table,
    improvement_table,
    metric_table,
)
from swarmdata.hub.catalog.catalog import load as load_dataset
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.atomic import write_file
from swarmdata.specs.model_choice import Source, with_models
from swarmdata.types import Episode

PANELS = 4
"""Columns of a table that its figure shows, from the left."""


def shown_cases(results: ResultSet) -> dict[str, Case]:
    """Cases with the baselines of their specs, and specs that have baselines only, by file name."""
    specs = {case.spec.hash() for case in results.cases}
    alone = [case for case in results.baselines if case.spec.hash() not in specs]
    cases = [results.with_baselines(case) for case in (*results.cases, *alone)]
    if len(cases) == 1:
        return {"table": cases[0]}
    names = [case.name for case in cases]
    return {
        name if names.count(name) == 1 else f"{name}-{case.spec.hash()[:8]}": case
        for name, case in zip(names, cases, strict=True)
    }


def tables_of(results: ResultSet) -> dict[str, Table]:
    """Every table of a report by file name: what compares datasets first, then each case."""
    compared = complete(results).tables
    tables = {"scores": metric_table(results)} if any(results.scores.values()) else {}
    if compared:
        tables["aggregates"] = aggregate_table(results)
    if len(compared) > 1:
        tables["improvement"] = improvement_table(results)
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

    `report.md` holds all tables and shows all figures.

    Args:
        folders: of result files, as `evaluate` saves them.
        out: folder to write to.
        runs: training runs whose learning curves are drawn together.
        data: folders of datasets whose own means are not known from the package or the cache.
        suffix: of figures: `.png`, `.svg` or `.pdf`.

    Returns:
        The tables as text.

    Raises:
        DatasetNotFoundError: there are no results.
        ResultsError: results that are stale, or cannot be compared.
        SchemaError: an unknown suffix.
        MissingExtraError: matplotlib is not installed; the tables are written all the same.
    """
    if suffix not in SUFFIXES:
        raise SchemaError(f"cannot draw figures as {suffix!r}, expected one of {SUFFIXES}.")
    results = read_results(folders, data=data)
    tables = tables_of(results)
    out.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        forms = {".md": table.to_markdown, ".csv": table.to_csv, ".tex": table.to_latex}
        for ending, form in forms.items():
            write_file(out / f"{name}{ending}", form().encode())
    exported = marl_eval(results)
    text = json.dumps(exported.document, allow_nan=False, separators=(",", ":"))
    write_file(out / "marl-eval.json", f"{text}\n".encode())
    write_file(out / "runs.csv", runs_csv(results).encode())
    figures = _draw(results, tables, out, suffix)
    if runs:
        figures["curves"] = _draw_curves(runs, out / f"curves{suffix}")
    left = f"Not in marl-eval.json: {', '.join(exported.left_out)}." if exported.left_out else ""
    write_file(out / "report.md", _page(tables, figures, left).encode())
    return "\n".join(f"{name}\n{table.to_text()}" for name, table in tables.items())


def _draw(
    results: ResultSet, tables: Mapping[str, Table], out: Path, suffix: str
) -> dict[str, Path]:
    """Draws what there is to draw; figures by name."""
    compared, cases = complete(results).tables, shown_cases(results)
    ours = [case for case in cases.values() if case.spec.world is not None]
    drawings: dict[str, Callable[[Path], None]] = {}
    if "scores" in tables:
        drawings["scores"] = partial(plot_scores, results)
    if compared:
        drawings["profile"] = partial(plot_profiles, compared)
    if "improvement" in tables:
        drawings["improvement"] = partial(plot_improvements, compared)
    if ours:
        drawings["pareto"] = partial(plot_pareto, ours)
    for name in cases:
        keys = [column.key for column in tables[name].columns][:PANELS]
        drawings[name] = partial(plot_estimates, tables[name].panels(keys))
    for name, draw in drawings.items():
        draw(out / f"{name}{suffix}")
    return {name: out / f"{name}{suffix}" for name in drawings}


def _draw_curves(runs: Sequence[Path], path: Path) -> Path:
    curves = {
        run.resolve().name: read_curve([run / "curve.csv"], "success", progress="update")
        for run in runs
    }
    plot_curves(curves, path, ylabel="team success (%)", factor=100.0)
    return path


def _page(tables: Mapping[str, Table], figures: Mapping[str, Path], note: str) -> str:
    """Tables with their figures, then figures without a table."""
    parts = ["# Report\n"]
    for name in dict.fromkeys([*tables, *figures]):
        parts.append(f"## {name}\n")
        if name in tables:
            parts.append(tables[name].to_markdown())
        if name in figures:
            parts.append(f"![{name}]({figures[name].name})\n")
    return "\n".join([*parts, f"{note}\n" if note else ""]).rstrip() + "\n"


def draw_training(files: Sequence[Path], metric: str, out: Path) -> None:
    """Draws the curves of online runs, one line each, by the stem of their `curve.csv` copies.

    Args:
        files: CSV files with a `frames` column.
        metric: column to draw; a share in [0, 1] unless it is `return`.
        out: the picture.
    """
    curves = {file.stem: read_curve([file], metric, progress="frames") for file in files}
    is_return = metric == "return"
    plot_curves(
        curves,
        out,
        ylabel="team return" if is_return else f"{metric.replace('_', ' ')} (%)",
        xlabel="joint steps of training",
        factor=1.0 if is_return else 100.0,
    )


def draw_learning(files: Sequence[Path], by: str, out: Path, *, log: bool = False) -> None:
    """Draws success and return of online runs by task and algorithm.

    Args:
        files: CSV files with a `frames` column; with a `seed` column for several runs in one.
        by: how the files are named; see `learning_curves.group_files`.
        out: the picture.
        log: whether joint steps are logarithmic.
    """
    plot_learning(group_files(files, by), out, log=log)


def draw_target(
    name: str,
    out: Path,
    index: int,
    task: str,
    observation: Source | None = None,
    communication: Source | None = None,
    *,
    size: int = 384,
    stride: int = 2,
) -> Episode:
    """Draws an episode, with lidar rays and messages where there are any; returns it.

    Args:
        name: a dataset's id for a recorded episode, else as `targets.find_target`.
        out: the `.gif`, `.mp4` or `.png` file.
        index: of the recorded episode, or of the reserved evaluation seed.
        task: of policies and tiers: a preset's name, or a spec's file.
        observation: what the robots sense; a recorded episode is observed again.
        communication: what they hear; the same.
        size: pixels of the arena's longer side.
        stride: control steps between two pictures of an animation.

    Raises:
        SchemaError: another kind of file, or no such episode.
    """
    check_clip(out)
    if is_dataset(name):
        dataset = load_dataset(name)
        if index >= len(dataset):
            raise SchemaError(f"{dataset.id} has {len(dataset)} episodes, none numbered {index}")
        spec = with_models(dataset.task, observation, communication)
        episode = reobserved_episode(dataset[index], dataset.task, spec)
    else:
        target = find_target(name, task, observation, communication)
        spec, seeds = target.spec, evaluation_seeds(index + 1)[index:]
        (episode,) = rollout(make_env(spec), target.policies[0], seeds)
    write_clip(episode, spec, out, size=size, stride=stride)
    return episode
