"""The table of tuned settings in docs/measurements.md is that of all trials."""

import re
from collections.abc import Sequence
from math import isnan, nan
from pathlib import Path

import numpy as np
import pytest

from swarmdata.evaluation.runs.algorithm_choice import CANDIDATES
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.settings import as_texts, override
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from tests.benchmarks.tuning_tables import (
    DATASETS,
    EVERY,
    chosen_trials,
    mean_scores,
    read_trials,
    row_of,
    scores_of,
    summary,
    tuned_on_all,
)
from tests.docs.marked_numbers import cell

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/measurements.md"


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
    trials = read_trials()
    means = [mean_scores(trials[name], EVERY) for name in ("matd3", "vdn")]
    first, second = (f"{scores.max() - scores[0]:.1f}" for scores in means)
    assert f"`matd3` is {first} points above the default, that of `vdn` {second}." in page


def test_the_table_of_six_datasets_is_that_of_the_trials() -> None:
    page = PAGE.read_text("utf-8")
    found = tuned_on_all(read_trials())
    assert set(found) == {"vdn", *CANDIDATES} - {"matd3"}
    for name, rows in found.items():
        for which, k in chosen_trials(rows).items():
            numbers = [mean_scores(rows, DATASETS)[k], *(scores_of(rows, d)[k] for d in DATASETS)]
            assert row_of(f"`{name}`, {which}", numbers) in _table_rows(page), (name, which)


@pytest.mark.parametrize("algorithm", ["iql", "maddpg_bc", "vdn"])
def test_the_study_of_tuned_settings_has_those_of_the_chosen_trial(algorithm: str) -> None:
    rows = read_trials()[algorithm]
    chosen = rows[chosen_trials(rows)["chosen"]]["settings"]
    plan = Study.from_file(ROOT / "cards/studies/tuned.yaml")
    default = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm).Config()
    shared = {name: value for name, value in plan.settings.items() if hasattr(default, name)}
    known = override(default, as_texts(shared))
    tuned = override(known, as_texts(plan.algorithms[f"{algorithm}-tuned"].settings))
    assert tuned == override(default, dict(each.split("=") for each in chosen.split("; ")))
    assert not {*plan.datasets} & {*DATASETS}


def test_the_page_says_what_tuning_is_worth_on_other_datasets() -> None:
    page = (ROOT / "docs/results/tuning.md").read_text("utf-8")
    changes = {
        name: round(cell(f"tuned/core:{name}-tuned:{name}", ROOT / "cards/studies")[0])
        for name in ("iql", "maddpg_bc", "vdn")
    }
    assert "gain {iql} points on six others".format_map(changes) in page
    lost = (f"{-changes[name]} (`{name}`)" for name in ("maddpg_bc", "vdn"))
    assert f"or lose {' and '.join(lost)}." in page
    rows = read_trials()["vdn"]
    scores = np.array([scores_of(rows, dataset) for dataset in DATASETS])
    change = scores[:, chosen_trials(rows)["chosen"]] - scores[:, 0]
    assert f"gain {change.mean():.0f} points on average on the six" in page
    assert (change < 0).sum() == 1, "lose on only one of them"


def _table_rows(page: str) -> list[list[str]]:
    return [row.strip("| ").split(" | ") for row in page.splitlines() if row.startswith("| ")]
