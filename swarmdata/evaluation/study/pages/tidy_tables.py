"""The tidy tables of a study: a row for each run, dataset, cell, and point of a learning curve."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case
from swarmdata.evaluation.runs.train import CURVE_METRICS
from swarmdata.evaluation.study.cells.cell_worker import RESULTS
from swarmdata.evaluation.study.cells.cells import Cell
from swarmdata.evaluation.study.cells.run_cells import folder_of
from swarmdata.evaluation.study.pages.collect_results import Findings, by_id
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.metrics import censored_times

MEANS = (
    "return",
    "success",
    "clean_success",
    "robot_collisions",
    "obstacle_collisions",
    "time_to_goal",
)
"""Metrics of the tidy table, as means over the episodes of a run."""

Row = Mapping[str, str | float | int | None]


def tidy_rows(found: Findings) -> list[Row]:
    """One row per run and dataset, of everything that was measured but sweeps."""
    keys = {(cell.label, folder): cell for cell, folder in _folders(found)}
    rows = []
    for case in _cases(found):
        for label, runs in case.runs.items():
            for result in runs:
                assert result.path is not None  # all were read from files
                cell = keys[label, result.path.parent]
                rows.append(_tidy(found, case, cell, result))
    return sorted(rows, key=lambda row: (str(row["dataset"]), str(row["label"]), str(row["seed"])))


def _folders(found: Findings) -> list[tuple[Cell, Path]]:
    return [(cell, folder_of(found.work, cell) / RESULTS) for cell in found.cells]


def _cases(found: Findings) -> list[Case]:
    """Of all datasets, each once: a full size is the study's own."""
    main = [*found.results.cases, *found.results.baselines]
    known = {case.name for case in main}
    more = found.sizes.cases if found.sizes else ()
    return main + [case for case in more if case.name not in known]


def _tidy(found: Findings, case: Case, cell: Cell, result: Result) -> Row:
    origin, metrics = result.provenance, result.evaluation.metrics
    times = {"time_to_goal": censored_times(metrics["time_to_goal"], case.time_limit)}
    means = {name: float(np.mean({**metrics, **times}[name])) for name in MEANS}
    score = math.nan
    if case.reference is not None:
        score = float(normalized_score(means["return"], case.reference))
    facts = found.facts.get(cell.name)
    return {
        "label": cell.label,
        "family": found.family(cell.label),
        "algorithm": cell.algorithm,
        "dataset": case.dataset or "",
        "task": result.evaluation.task,
        "digest": origin.digest or "",
        "n_steps": facts.figures.n_steps if facts else "",
        "seed": origin.seed,
        "updates": origin.updates,
        "frames": origin.frames,
        "episodes": len(result.evaluation.seeds),
        "score": score,
        **means,
        "cell": cell.key[:16],
    }


def data_rows(found: Findings) -> list[Row]:
    """One row per dataset: what its own episodes achieved."""
    scores = {case.dataset: case.data_score for case in _cases(found)}
    rows: list[Row] = []
    for key, facts in sorted(by_id(found.facts).items()):
        figures, score = facts.figures, scores.get(key)
        rows.append(
            {
                "dataset": key,
                "digest": facts.digest,
                "n_steps": figures.n_steps,
                "n_episodes": figures.n_episodes,
                "score": math.nan if score is None else score,
                "return": figures.mean_return,
                "success": figures.success,
                "clean_success": figures.clean_success,
                "robot_collisions": facts.robot_collisions,
                "obstacle_collisions": facts.obstacle_collisions,
            }
        )
    return rows


def cost_rows(found: Findings) -> list[Row]:
    """One row per cell: what it took, and where."""
    rows: list[Row] = []
    for cell in sorted(found.cells, key=lambda cell: cell.name):
        cost = found.costs[cell.name]
        rows.append(
            {
                "cell": cell.name,
                "seeds": len(cell.seeds),
                "updates": cell.n_updates,
                "updates_per_second": cost.updates_per_second,
                "wall_seconds": cost.wall_seconds,
                "cpu_seconds": cost.cpu_seconds,
                "peak_mb": cost.peak_mb,
                "attempts": len(cost.attempts),
                **{name: cost.machine.get(name) for name in ("processor", "cores", "load")},
            }
        )
    return rows


def track_rows(found: Findings) -> list[Row]:
    """The learning curves, as means over seeds with the lowest and the highest."""
    rows: list[Row] = []
    for cell in sorted(found.cells, key=lambda cell: cell.name):
        for metric in CURVE_METRICS:
            curve = found.learning(cell, metric)
            if curve is None:
                continue
            parts: dict[str, Callable[..., object]] = {
                "mean": np.mean,
                "low": np.min,
                "high": np.max,
            }
            ends = {name: part(curve.values, axis=0) for name, part in parts.items()}
            for k, update in enumerate(curve.progress.tolist()):
                values = {name: float(end[k]) for name, end in ends.items()}  # type: ignore[index]
                rows.append({"cell": cell.name, "metric": metric, "update": int(update), **values})
    return rows
