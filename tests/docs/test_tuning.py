"""The table of tuned settings in docs/measurements.md is that of all trials."""

import csv
import re
from math import comb
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
DATASETS = ("coop_nav-medium-replay", "transport-medium-replay")


def best_of_three(scores: list[float]) -> float:
    """The expected best of 3 of the scores."""
    ranked = sorted(scores)
    return sum(score * comb(k, 2) for k, score in enumerate(ranked)) / comb(len(ranked), 3)


def test_the_table_is_that_of_the_trials() -> None:
    text = (DOCS / "measurements/tuning-two-datasets.csv").read_text("utf-8")
    trials: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader(text.splitlines()):
        trials.setdefault(row["algorithm"], []).append(row)
    page = (DOCS / "measurements.md").read_text("utf-8").partition("## Tuned settings")[2]
    orders = []
    for algorithm, rows in trials.items():
        found = []
        for dataset in DATASETS:
            scores = [float(row[dataset]) for row in rows]
            estimates = [float(row[f"fqe_pessimistic on {dataset}"]) for row in rows]
            chosen = scores[estimates.index(max(estimates))]
            found += [scores[0], best_of_three(scores), max(scores), chosen]
        match = re.search(rf"^\| `{algorithm}` \| (.+) \|$", page, re.MULTILINE)
        assert match, algorithm
        shown = [float(cell.replace("−", "-")) for cell in match[1].split(" | ")]
        assert all(abs(a - b) < 0.1 for a, b in zip(shown, found, strict=True)), algorithm
        orders.append(found)
    for default, best in ((0, 2), (4, 6)):
        ranks = [sorted(range(4), key=lambda k: orders[k][column]) for column in (default, best)]
        assert ranks[0] == ranks[1], "the order of the algorithms stays"
