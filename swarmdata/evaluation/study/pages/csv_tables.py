"""The CSV tables of a study: a row for each run, dataset, cell, and point of a learning curve."""

import itertools
import json
import math
from collections.abc import Mapping

import numpy as np

from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case
from swarmdata.evaluation.results.result_tables import estimate, quantities_of
from swarmdata.evaluation.study.cells.cells import RESULTS_FOLDER, Cell
from swarmdata.evaluation.study.pages.collect_results import Findings, facts_by_dataset
from swarmdata.learn.training.run_files import CURVE, CURVE_METRICS
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.metrics import censored_times

RUN_METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions",
               "time_to_goal")  # fmt: skip
"""Metrics of the table of runs, as means over the episodes of a run."""

Row = Mapping[str, str | float | int | None]


def run_rows(found: Findings) -> list[Row]:
    """One row per run and dataset, without sweeps."""
    cells = {cell.folder(found.work) / RESULTS_FOLDER: cell for cell in found.cells}
    rows = []
    for case in _cases(found):
        for result in itertools.chain.from_iterable(case.runs.values()):
            assert result.path is not None  # all results were read from files
            rows.append(_run_row(found, case, cells[result.path.parent], result))
    return sorted(rows, key=lambda row: (str(row["dataset"]), str(row["label"]), str(row["seed"])))


def _cases(found: Findings) -> list[Case]:
    """The cases of all datasets, each once: a full size is a dataset of the grid."""
    grid = [*found.results.cases, *found.results.baselines]
    names = {case.name for case in grid}
    sized = found.sizes.cases if found.sizes else ()
    return grid + [case for case in sized if case.name not in names]


def _run_row(found: Findings, case: Case, cell: Cell, result: Result) -> Row:
    origin, metrics = result.provenance, result.evaluation.metrics
    times = censored_times(metrics["time_to_goal"], case.time_limit)
    means = {k: float(np.mean(times if k == "time_to_goal" else metrics[k])) for k in RUN_METRICS}
    score = math.nan
    if case.reference is not None:
        score = float(normalized_score(means["return"], case.reference))
    facts = found.facts.get(cell.name)
    return {
        "label": cell.label,
        "family": found.family(cell.label),
        "algorithm": cell.algorithm,
        "dataset": case.dataset or "",
        "rewards": weights_text(cell.rewards),
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


def weights_text(rewards: Mapping[str, object]) -> str:
    """Weights of rewards that a row learned from, as JSON; empty: those of its data."""
    return json.dumps(rewards, sort_keys=True) if rewards else ""


def estimate_rows(found: Findings) -> list[Row]:
    """One row per dataset, label and quantity: the mean with its interval, in stored units."""
    rows: list[Row] = []
    for case in _cases(found):
        for label, runs in case.runs.items():
            origin = runs[0].provenance
            for quantity in quantities_of(case):
                ends = zip(("mean", "low", "high"), estimate(quantity, case, label), strict=True)
                rows.append(
                    {
                        "label": label,
                        "family": found.family(label),
                        "dataset": case.dataset or "",
                        "rewards": weights_text(case.rewards.get(label, {})),
                        "digest": origin.digest or "",
                        "seeds": len(runs),
                        "updates": origin.updates,
                        "frames": origin.frames,
                        "episodes": len(runs[0].evaluation.seeds),
                        "quantity": quantity.column.key,
                        **dict(ends),
                    }
                )
    return sorted(rows, key=lambda row: (str(row["dataset"]), str(row["label"])))


def dataset_rows(found: Findings) -> list[Row]:
    """One row per dataset: what its own episodes achieved."""
    scores = {case.dataset: case.data_score for case in _cases(found)}
    return [
        {
            "dataset": key,
            "digest": facts.digest,
            "n_steps": facts.figures.n_steps,
            "n_episodes": facts.figures.n_episodes,
            "score": scores.get(key),
            "return": facts.figures.mean_return,
            "success": facts.figures.success,
            "clean_success": facts.figures.clean_success,
            "robot_collisions": facts.robot_collisions,
            "obstacle_collisions": facts.obstacle_collisions,
        }
        for key, facts in sorted(facts_by_dataset(found.facts).items())
    ]


def cost_rows(found: Findings) -> list[Row]:
    """One row per cell: its cost, and the machine."""
    cells = {cell.name: cell for cell in found.cells}
    return [
        {
            "cell": name,
            "seeds": len(cells[name].seeds),
            "updates": cells[name].n_updates,
            "updates_per_second": cost.updates_per_second,
            "wall_seconds": cost.wall_seconds,
            "cpu_seconds": cost.cpu_seconds,
            "peak_mb": cost.peak_mb,
            "attempts": len(cost.attempts),
            **{name: cost.machine.get(name) for name in ("processor", "cores", "load")},
        }
        for name, cost in sorted(found.costs.items())
    ]


def curve_rows(found: Findings) -> list[Row]:
    """One row per point of an offline learning curve: mean over seeds, lowest and highest."""
    rows: list[Row] = []
    offline = [cell for cell in found.cells if cell.kind == "offline"]
    for cell in sorted(offline, key=lambda cell: cell.name):
        for metric in CURVE_METRICS:
            curve = found.training_curve(cell, CURVE, metric)
            if curve is None:
                continue
            means, lows, highs = (part(curve.values, axis=0) for part in (np.mean, np.min, np.max))
            where = {"cell": cell.name, "metric": metric}
            for update, mean, low, high in zip(curve.progress, means, lows, highs, strict=True):
                ends = {"mean": float(mean), "low": float(low), "high": float(high)}
                rows.append({**where, "update": int(update), **ends})
    return rows
