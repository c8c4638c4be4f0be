"""The table of tuned settings in docs/measurements.md is that of all trials."""

import re
from collections.abc import Sequence
from math import isnan, nan
from pathlib import Path

import numpy as np

from tests.benchmarks.tuning_tables import DATASETS, read_trials, scores_of, summary

PAGE = Path(__file__).parents[2] / "docs/measurements.md"


def tuned() -> dict[str, list[float]]:
    """Of each algorithm: default, best of 3, best, chosen by estimates; on one and the other."""
    return {name: summary(rows) for name, rows in read_trials().items()}


def test_the_table_is_that_of_the_trials() -> None:
    page = PAGE.read_text("utf-8").partition("## Tuned settings")[2].partition("\n## ")[0]
    for algorithm, found in tuned().items():
        match = re.search(rf"^\| `{algorithm}` \| (.+) \|$", page, re.MULTILINE)
        assert match, algorithm
        shown = [
            nan if cell == "–" else float(cell.replace("−", "-")) for cell in match[1].split(" | ")
        ]
        assert np.allclose(shown, found, atol=0.06, equal_nan=True), algorithm


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
    assert (
        f"{min(losses):.0f} to {max(losses):.0f} points less than the defaults"
        in PAGE.read_text("utf-8")
    )


def test_what_tuning_is_worth_by_the_mean_of_both_datasets() -> None:
    page = " ".join(PAGE.read_text("utf-8").split())
    mean = {
        name: np.mean([scores_of(rows, each) for each in DATASETS], axis=0)
        for name, rows in read_trials().items()
    }
    gains = {name: scores.max() - scores[0] for name, scores in mean.items()}
    first, *others = sorted(gains, key=lambda name: -gains[name])[:4]
    assert f"`{first}` gains {gains[first]:.1f} points" in page
    for name in (*others, "filtered_bc"):
        assert f"`{name}` {gains[name]:.1f}" in page
    lead = [take(mean["filtered_bc"]) - take(mean["iql"]) for take in (lambda x: x[0], max)]
    assert f"shrinks from {lead[0]:.1f} to {lead[1]:.1f}" in page
