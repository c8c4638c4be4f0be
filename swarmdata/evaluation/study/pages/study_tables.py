"""The tables of a study, as Markdown and as CSV."""

import itertools
import json
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED, format_estimate, format_number
from swarmdata.evaluation.results.result_files import Result
from swarmdata.evaluation.results.result_set import Case
from swarmdata.evaluation.results.result_tables import QUANTITIES, estimate, quantities_of
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cells import RESULTS_FOLDER, Cell
from swarmdata.evaluation.study.pages.collect_results import Findings, facts_by_dataset
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard
from swarmdata.learn.training.run_files import CURVE, CURVE_METRICS
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.metrics import censored_times
from swarmdata.specs.plain_names import without_version

ONLINE_COLUMNS = ("score", "return", "success", "clean_success", "robot_collisions",
                  "obstacle_collisions")  # fmt: skip

RUN_METRICS = ("return", "success", "clean_success", "robot_collisions", "obstacle_collisions",
               "time_to_goal")  # fmt: skip
"""Metrics of the table of runs, as means over the episodes of a run."""

Row = Mapping[str, str | float | int | None]


def scoreboard_table(board: Scoreboard, *, is_ranked: bool = True) -> str:
    """A row for each algorithm, a column for each dataset; the first row is the mean of the data.

    Ranked ones have `Scoreboard.leaders` in bold.
    """
    data_row = ["mean of the data", ""]
    rows = {label: [f"`{label}`", family] for label, family in board.families.items()}
    for name, found in board.estimates.items():
        mean = board.data.get(name)
        data_row.append(UNDEFINED if mean is None else format_number(mean, board.column))
        bold = board.leaders(name) if is_ranked and found else []
        for label, row in rows.items():
            text = format_estimate(found[label], board.column) if label in found else UNDEFINED
            row.append(f"**{text}**" if label in bold else text)
    head = ("algorithm", "family", *map(without_version, board.estimates))
    return markdown.table(head, [data_row, *rows.values()])


def online_table(cases: Sequence[Case]) -> str:
    """The online algorithms, evaluated in the same way; empty if there are none."""
    quantities, rows = [QUANTITIES[key] for key in ONLINE_COLUMNS], []
    for case in cases:
        for label, runs in case.runs.items():
            cells = [
                format_estimate(estimate(each, case, label), each.column)
                if each in quantities_of(case)
                else UNDEFINED
                for each in quantities
            ]
            frames = runs[0].provenance.frames
            rows.append((f"`{label}`", str(len(runs)), f"{frames or 0:,}", *cells))
    head = ("algorithm", "seeds", "joint steps", *(each.column.header for each in quantities))
    return markdown.table(head, rows) if rows else ""


def training_table(found: Findings) -> str:
    """How long each offline algorithm trained: updates, batch, width, epochs over the data."""
    rows = []
    for label in found.study.algorithms:
        cells = [cell for cell in found.cells if cell.label == label and cell.kind == "offline"]
        if not cells:
            continue
        updates = number_range({cell.n_updates for cell in cells})
        batches = number_range({cell.config["batch_size"] for cell in cells})
        rows.append((f"`{label}`", updates, batches, _hidden(cells), _epochs(found, cells)))
    head = ("algorithm", "updates", "joint transitions in a batch", "hidden units", "epochs")
    return markdown.table(head, rows)


def _hidden(cells: Sequence[Cell]) -> str:
    widths = [
        ", ".join(map(str, value))
        for cell in cells
        for name, value in cell.config.items()
        if name.endswith("hidden") and isinstance(value, list)
    ]
    return "; ".join(dict.fromkeys(widths)) or UNDEFINED


def _epochs(found: Findings, cells: Sequence[Cell]) -> str:
    """Updates times batch over the joint steps of the training split; smallest to largest."""
    epochs = [
        cell.n_updates * cell.config["batch_size"] / found.facts[cell.name].train_steps
        for cell in cells
    ]
    ends = (f"{n:.2g}" if n < 10 else f"{n:,.0f}" for n in (min(epochs), max(epochs)))
    return " to ".join(dict.fromkeys(ends))


def cost_table(found: Findings) -> str:
    """The cost of training and evaluation by algorithm, over all of its cells."""
    rows = []
    for label in dict.fromkeys(cell.label for cell in found.cells):
        cells = [cell for cell in found.cells if cell.label == label]
        costs = [found.costs[cell.name] for cell in cells]
        updates = number_range({cell.n_updates for cell in cells if cell.kind == "offline"})
        rows.append((f"`{label}`", str(len(cells)), updates, *_cost_cells(costs)))
    rows.append(
        ("all", str(len(found.cells)), "", *_cost_cells(list(found.costs.values()), is_total=True))
    )
    head = ("algorithm", "cells", "updates of a cell", "updates per second", "processor time",
            "wall-clock time", "peak memory")  # fmt: skip
    return markdown.table(head, rows)


def number_range(values: Collection[int]) -> str:
    """The smallest and the largest number as text; a dash without numbers."""
    ends = dict.fromkeys((min(values), max(values))) if values else ()
    return " to ".join(f"{value:,}" for value in ends) or UNDEFINED


def _cost_cells(costs: Sequence[Cost], *, is_total: bool = False) -> tuple[str, ...]:
    speeds = [cost.updates_per_second for cost in costs]
    known = [speed for speed in speeds if speed]
    speed = f"{sum(known) / len(known):,.0f}" if known and not is_total else UNDEFINED
    return (
        speed,
        duration(sum(cost.cpu_seconds for cost in costs)),
        duration(sum(cost.wall_seconds for cost in costs)),
        f"{max((cost.peak_mb for cost in costs), default=0.0) / 1000:.1f} GB",
    )


def duration(seconds: float) -> str:
    """A duration in a readable unit: 42 s, 3.5 min, 2.1 h."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 3600 else f"{seconds / 3600:.1f} h"


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
