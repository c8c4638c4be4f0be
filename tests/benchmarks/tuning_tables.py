"""What `swarmdata tune` found for many algorithms on two datasets: trials, a table and curves.

    python -m tests.benchmarks.tuning_tables             prints the table, draws the curves
    python -m tests.benchmarks.tuning_tables FOLDER...   adds the trials of folders of `tune` first

The trials are in docs/measurements/tuning-two-datasets.csv.
"""

import csv
import json
import sys
from collections.abc import Mapping, Sequence
from math import nan
from pathlib import Path

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.drawing.style import (
    FAMILY_OF,
    draw_grid,
    draw_legend,
    family_looks,
    figure,
    line_looks,
)
from swarmdata.evaluation.results.estimate_table import to_csv
from swarmdata.evaluation.tuning.tuning_record import expected_scores
from swarmdata.types import Double

MEASURED = Path(__file__).parents[2] / "docs/measurements"
TRIALS, CURVES = MEASURED / "tuning-two-datasets.csv", MEASURED / "tuning-two-datasets.png"
DATASETS = ("coop_nav-medium-replay", "transport-medium-replay")
ESTIMATE = "fqe_pessimistic"
SUBSET = "-200k"  # ends the names of the parts of datasets that are tuned on

Trials = dict[str, list[dict[str, str]]]
"""The rows of each algorithm, the default first."""


def read_trials(file: Path = TRIALS) -> Trials:
    trials: Trials = {}
    for row in csv.DictReader(file.read_text("utf-8").splitlines()):
        trials.setdefault(row["algorithm"], []).append(row)
    return trials


def trials_of(folder: Path) -> list[dict[str, str]]:
    """The trials in a folder that `swarmdata tune` wrote, with rounded numbers."""
    algorithm = json.loads((folder / "tuning.json").read_text("utf-8"))["algorithm"]
    rows = csv.DictReader((folder / "trials.csv").read_text("utf-8").splitlines())
    found = []
    for row in rows:
        names = list(row)[1 : list(row).index("score")]
        settings = "; ".join(f"{name}={row[name]}" for name in names if row[name])
        numbers = {}
        for dataset in DATASETS:
            estimate = row.get(f"{ESTIMATE}:{dataset}{SUBSET}")
            numbers[dataset] = f"{float(row[f'score:{dataset}{SUBSET}']):.1f}"
            numbers[f"{ESTIMATE} on {dataset}"] = f"{float(estimate):.3f}" if estimate else ""
        found.append(
            {"algorithm": algorithm, "trial": row["trial"], "settings": settings, **numbers}
        )
    return found


def scores_of(rows: Sequence[Mapping[str, str]], dataset: str) -> Double:
    return np.array([float(row[dataset]) for row in rows])


def by_estimate(rows: Sequence[Mapping[str, str]], dataset: str) -> float:
    """The score of the trial with the highest estimate; not a number where there is none."""
    estimates = [row[f"{ESTIMATE} on {dataset}"] for row in rows]
    if not all(estimates):
        return nan
    return float(scores_of(rows, dataset)[np.argmax(np.array(estimates, dtype=np.float64))])


def summary(rows: Sequence[Mapping[str, str]]) -> list[float]:
    """Default, expected best of 3, best of all, and chosen by estimates; of both datasets."""
    found: list[float] = []
    for dataset in DATASETS:
        scores = scores_of(rows, dataset)
        best = expected_scores(scores, scores)
        found += [best[0], best[2], best[-1], by_estimate(rows, dataset)]
    return found


def table(trials: Trials) -> str:
    """The rows of the table in docs/measurements.md."""
    lines = [
        [
            f"`{name}`",
            *("–" if np.isnan(v) else f"{v:.1f}".replace("-", "−") for v in summary(rows)),
        ]
        for name, rows in trials.items()
    ]
    heads = ("default", "best of 3", "best of 12", "by estimate")
    return markdown.table(["algorithm", *heads, *heads], lines, is_numeric=True)


def draw(trials: Trials, path: Path) -> None:
    looks = line_looks(family_looks({name: FAMILY_OF[name] for name in trials}))
    with figure(path, width=7.0, height=2.6) as drawing:
        panels = drawing.subplots(1, len(DATASETS))
        for axes, dataset in zip(panels, DATASETS, strict=True):
            for name, rows in trials.items():
                scores = scores_of(rows, dataset)
                curve = expected_scores(scores, scores)
                axes.plot(range(1, len(curve) + 1), curve, label=name, **looks[name])
            axes.set(title=dataset, xlabel="trials", xticks=(1, 4, 8, 12))
            draw_grid(axes, "y")
        panels[0].set_ylabel("expected best score")
        draw_legend(drawing, panels[0].get_lines())


if __name__ == "__main__":
    known = read_trials()
    for rows in map(trials_of, map(Path, sys.argv[1:])):
        known[rows[0]["algorithm"]] = rows
    TRIALS.write_text(to_csv([row for rows in known.values() for row in rows]), "utf-8")
    print(table(known))
    draw(known, CURVES)
