"""What `swarmdata tune` found for many algorithms on the same datasets: trials, tables and curves.

    python -m tests.benchmarks.tuning_tables             prints the tables, draws the curves
    python -m tests.benchmarks.tuning_tables FOLDER...   adds the trials of folders of `tune` first

The trials are in docs/measurements/tuning.csv.
"""

import csv
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
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
TRIALS, CURVES = MEASURED / "tuning.csv", MEASURED / "tuning.png"
EVERY = ("coop_nav-medium-replay", "transport-medium-replay")  # every algorithm was tuned on these
DATASETS = (
    *EVERY,
    "formation-medium-replay",
    "warehouse-medium-replay",
    "coop_nav-expert",
    "warehouse-expert",
)
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
            score = row.get(f"score:{dataset}{SUBSET}")
            estimate = row.get(f"{ESTIMATE}:{dataset}{SUBSET}")
            numbers[dataset] = f"{float(score):.1f}" if score else ""
            numbers[f"{ESTIMATE} on {dataset}"] = f"{float(estimate):.3f}" if estimate else ""
        found.append(
            {"algorithm": algorithm, "trial": row["trial"], "settings": settings, **numbers}
        )
    return found


def merged(
    old: Sequence[Mapping[str, str]], new: Sequence[Mapping[str, str]]
) -> list[dict[str, str]]:
    """Old trials with the numbers of new ones, which may be of other datasets.

    Raises:
        ValueError: the trials have other settings.
    """
    if not old:
        return [dict(row) for row in new]
    if [row["settings"] for row in old] != [row["settings"] for row in new]:
        raise ValueError(f"{new[0]['algorithm']} has other trials in {TRIALS}: other settings")
    return [
        {**a, **{name: value for name, value in b.items() if value}}
        for a, b in zip(old, new, strict=True)
    ]


def scores_of(rows: Sequence[Mapping[str, str]], dataset: str) -> Double:
    return np.array([float(row[dataset]) for row in rows])


def mean_scores(rows: Sequence[Mapping[str, str]], datasets: Iterable[str]) -> Double:
    """The mean of each trial over datasets."""
    mean: Double = np.mean([scores_of(rows, each) for each in datasets], axis=0)
    return mean


def by_estimate(rows: Sequence[Mapping[str, str]], dataset: str) -> float:
    """The score of the trial with the highest estimate; not a number where there is none."""
    estimates = [row[f"{ESTIMATE} on {dataset}"] for row in rows]
    if not all(estimates):
        return nan
    return float(scores_of(rows, dataset)[np.argmax(np.array(estimates, dtype=np.float64))])


def summary(rows: Sequence[Mapping[str, str]]) -> list[float]:
    """Default, expected best of 3, best of all, and chosen by estimates; of two datasets."""
    found: list[float] = []
    for dataset in EVERY:
        scores = scores_of(rows, dataset)
        best = expected_scores(scores, scores)
        found += [best[0], best[2], best[-1], by_estimate(rows, dataset)]
    return found


def tuned_on_all(trials: Trials) -> Trials:
    """The algorithms that were tuned on all datasets."""
    return {name: rows for name, rows in trials.items() if all(rows[0][each] for each in DATASETS)}


def chosen_trials(rows: Sequence[Mapping[str, str]]) -> dict[str, int]:
    """The default, and the trial with the highest mean over all datasets."""
    return {"default": 0, "chosen": int(np.argmax(mean_scores(rows, DATASETS)))}


def row_of(name: str, numbers: Iterable[float]) -> list[str]:
    """A row of a table."""
    return [name, *("–" if np.isnan(v) else f"{v:.1f}".replace("-", "−") for v in numbers)]


def tables(trials: Trials) -> str:
    """The two tables in docs/measurements.md."""
    heads = ("default", "best of 3", "best of 12", "by estimate")
    separate = [row_of(f"`{name}`", summary(rows)) for name, rows in trials.items()]
    common = [
        row_of(
            f"`{name}`, {which}",
            [mean_scores(rows, DATASETS)[k], *(scores_of(rows, each)[k] for each in DATASETS)],
        )
        for name, rows in tuned_on_all(trials).items()
        for which, k in chosen_trials(rows).items()
    ]
    names = [f"`{each}`" for each in DATASETS]
    return "\n\n".join(
        (
            markdown.table(["algorithm", *heads, *heads], separate, is_numeric=True),
            markdown.table(["algorithm", "mean", *names], common, is_numeric=True),
        )
    )


def draw(trials: Trials, path: Path) -> None:
    looks = line_looks(family_looks({name: FAMILY_OF[name] for name in trials}))
    with figure(path, width=7.0, height=2.6) as drawing:
        panels = drawing.subplots(1, len(EVERY))
        for axes, dataset in zip(panels, EVERY, strict=True):
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
        known[rows[0]["algorithm"]] = merged(known.get(rows[0]["algorithm"], []), rows)
    columns = ["algorithm", "trial", "settings"]
    for dataset in DATASETS:
        columns += [dataset, f"{ESTIMATE} on {dataset}"]
    every = [row for rows in known.values() for row in rows]
    table = to_csv([{name: row.get(name, "") for name in columns} for row in every])
    TRIALS.write_text(table, "utf-8")
    print(tables(read_trials()))
    draw(read_trials(), CURVES)
