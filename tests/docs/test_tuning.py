"""The table of tuned settings in docs/measurements.md is that of all trials."""

import csv
import re
from collections.abc import Sequence
from math import comb, isnan, nan
from pathlib import Path

import numpy as np

DOCS = Path(__file__).parents[2] / "docs"
DATASETS = ("coop_nav-medium-replay", "transport-medium-replay")


def best_of_three(scores: list[float]) -> float:
    """The expected best of 3 of the scores."""
    ranked = sorted(scores)
    return sum(score * comb(k, 2) for k, score in enumerate(ranked)) / comb(len(ranked), 3)


def tuned() -> dict[str, list[float]]:
    """Of each algorithm: default, best of 3, best, chosen by estimates; on one and the other."""
    text = (DOCS / "measurements/tuning-two-datasets.csv").read_text("utf-8")
    trials: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader(text.splitlines()):
        trials.setdefault(row["algorithm"], []).append(row)
    found: dict[str, list[float]] = {}
    for algorithm, rows in trials.items():
        for dataset in DATASETS:
            scores = [float(row[dataset]) for row in rows]
            estimates = [row[f"fqe_pessimistic on {dataset}"] for row in rows]
            chosen = nan
            if all(estimates):
                chosen = scores[max(range(len(rows)), key=lambda k: float(estimates[k]))]
            found.setdefault(algorithm, []).extend(
                (scores[0], best_of_three(scores), max(scores), chosen)
            )
    return found


def test_the_table_is_that_of_the_trials() -> None:
    page = (DOCS / "measurements.md").read_text("utf-8").partition("## Tuned settings")[2]
    page = page.partition("\n## ")[0]
    for algorithm, found in tuned().items():
        match = re.search(rf"^\| `{algorithm}` \| (.+) \|$", page, re.MULTILINE)
        assert match, algorithm
        shown = [
            nan if cell == "–" else float(cell.replace("−", "-")) for cell in match[1].split(" | ")
        ]
        assert np.allclose(shown, found, atol=0.1, equal_nan=True), algorithm


def test_what_the_page_says_of_tuning() -> None:
    found = tuned()

    def order(column: int, names: Sequence[str]) -> list[str]:
        return sorted(names, key=lambda name: found[name][column])

    assert order(0, list(found))[-4:] == order(2, list(found))[-4:]
    assert order(0, ["qmix", "filtered_bc"]) != order(2, ["qmix", "filtered_bc"])
    for other in ("omiga", "omar"):
        assert order(0, ["cfcql", other]) != order(2, ["cfcql", other])
    for column in (0, 4):
        assert order(column, list(found)[:4]) == order(column + 2, list(found)[:4])
    assert order(6, list(found))[-1] == "filtered_bc"
    losses = [row[0] - row[3] for name, row in found.items() if name not in ("bc", "filtered_bc")]
    losses = [each for each in losses if not isnan(each)]
    page = (DOCS / "measurements.md").read_text("utf-8")
    assert f"{min(losses):.0f} to {max(losses):.0f} points less than the defaults" in page
