"""Numbers of the pages of results are those of the results' files."""

import csv
import math
import re
from itertools import combinations
from pathlib import Path

import pytest
import yaml

from tests.benchmarks.tuning_tables import DATASETS as TUNED_ON
from tests.docs.marked_numbers import MARK, cell, faults, readme_scores

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "cards/studies"
PAGES = sorted(
    page for page in (ROOT / "docs/results").glob("*.md") if page.name != "README.md"
)  # fmt: skip


@pytest.mark.parametrize("page", [*PAGES, ROOT / "docs/datasets.md"], ids=lambda page: page.stem)
def test_numbers_are_those_of_the_files(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(MARK.findall(text)) >= 10
    assert not list(faults(text, STUDIES))


QUESTIONS = [page for page in PAGES if page.stem != "claims"]
"""Pages that answer one question each."""


@pytest.mark.parametrize("page", QUESTIONS, ids=lambda page: page.stem)
def test_a_page_has_a_claim_one_short_table_a_limit_and_a_command(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.split("\n\n")[1].startswith("**"), "the claim"
    assert text.count("\n|---|") == 1
    assert len(re.findall(r"^\| ", text, re.MULTILINE)) <= 1 + 10
    assert text.count("\n![") == (page.stem != "simulators")
    assert "\n## What this does not show\n" in text
    assert re.search(r"swarmdata (study|sweep) ", text.partition("\nRun it again")[2])


def _rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))


def test_the_cost_of_all_studies_is_the_sum_of_their_costs() -> None:
    """Cells that two studies share, as `tuned` and `regimes` do, count once."""
    files = STUDIES.glob("*/costs.csv")
    rows = {(row["cell"], row["cpu_seconds"]) for file in files for row in _rows(file)}
    hours = sum(float(seconds) for _, seconds in rows) / 3600
    text = (ROOT / "docs/results/README.md").read_text(encoding="utf-8")
    assert f"took {hours:.0f} hours of processor time for {len(rows)} combinations" in text


def test_what_doubling_the_updates_changes() -> None:
    text = (ROOT / "docs/results/training-length.md").read_text(encoding="utf-8")
    plan = yaml.safe_load((STUDIES / "doubling/study.yaml").read_text(encoding="utf-8"))
    labels = [label for label in plan["algorithms"] if not label.endswith("-2x")]

    def score(label: str, name: str) -> float:
        return cell(f"doubling:{label}:{name}:score", STUDIES)[0]

    pairs = [(a, b, name) for a, b in combinations(labels, 2) for name in plan["datasets"]]
    kept = sum(
        (score(a, name) > score(b, name)) == (score(f"{a}-2x", name) > score(f"{b}-2x", name))
        for a, b, name in pairs
    )
    assert f"{kept} of {len(pairs)} pairs of algorithms keep their order" in text
    gains = [score(f"{a}-2x", name) - score(a, name) for a in labels for name in plan["datasets"]]
    assert f"by up to {max(gains):.0f} points" in text


def test_what_training_in_the_task_is_worth() -> None:
    """Distances of the best algorithms online and offline, and of `mappo` and `matd3`."""
    online = _rows(STUDIES / "online/estimates.csv")
    offline = _rows(STUDIES / "regimes/estimates.csv")
    tasks = ("coop_nav", "formation", "transport", "warehouse")

    def best(rows: list[dict[str, str]], ends: tuple[str, str]) -> float:
        return max(
            float(row["mean"])
            for row in rows
            if (row["quantity"], row["family"] == "ablations") == ("score", False)
            and row["label"].endswith(ends[0])
            and row["dataset"].removesuffix("-v1") == ends[1]
        )

    lead, behind = [], {}
    for task in tasks:
        found = best(online, (f"-{task}", ""))
        lead.append(found - best(offline, ("", f"{task}-medium-replay")))
        mappo = cell(f"online:mappo-{task}::score", STUDIES)[0]
        behind[task] = mappo - cell(f"regimes:matd3:{task}-medium-replay:score", STUDIES)[0]
    page = (ROOT / "docs/results/online.md").read_text(encoding="utf-8")
    said = "by {1:.0f} points on `formation`, {0:.0f} on `coop_nav`, {3:.0f} on `warehouse` and "
    assert f"{said}{{2:.0f}} on `transport`".format(*lead) in page
    claims = (ROOT / "docs/results/claims.md").read_text(encoding="utf-8")
    assert max(behind["coop_nav"], behind["formation"]) < 3
    assert (
        "`matd3` is within 3 points on `coop_nav` and `formation`, and "
        f"{behind['warehouse']:.0f} behind on `warehouse`." in claims
    )


def test_sentences_about_the_core_are_those_of_the_files() -> None:
    """Everyone's largest distance to the best of a dataset, and the mean of what `auto` takes."""
    text = (ROOT / "docs/results/core.md").read_text(encoding="utf-8")
    core = yaml.safe_load((STUDIES / "regimes/study.yaml").read_text(encoding="utf-8"))["core"]
    labels = {row["label"] for row in _rows(STUDIES / "regimes/core.csv")}
    scores = {
        (label, name): cell(f"regimes:{label}:{name}:score", STUDIES)[0]
        for label in labels
        for name in core
    }
    best = {name: max(scores[label, name] for label in labels) for name in core}
    worst = [max(best[name] - scores[label, name] for name in core) for label in labels]
    assert f"at least {math.floor(min(worst))} points below the best on one of the twelve" in text
    assert (len(labels), len(core)) == (12, 12)
    rest = [name for name in core if name not in TUNED_ON]
    assert len(rest) == 6
    means = {label: sum(scores[label, name] for name in rest) / 6 for label in labels}
    assert max(means, key=lambda label: means[label]) == "vdn"
    tuning = (ROOT / "docs/results/tuning.md").read_text(encoding="utf-8")
    others = (round(means[label]) for label in ("vdn", "filtered_bc", "bc"))
    assert "means over these six datasets are {}, {} and {}.".format(*others) in tuning
    choices = _rows(ROOT / "docs/measurements/choosing-an-algorithm.csv")
    taken = {row["dataset"].strip("`"): row["auto"].strip("`") for row in choices}
    above = {name for name in core if scores["matd3", name] > scores["iql", name]}
    assert above == {name for name in core if taken[name] in ("iql", "matd3")}
    mean = sum(scores[taken[name], name] for name in core) / len(core)
    assert f"have a mean of {mean:.0f} " in text


def test_five_other_seeds_agree() -> None:
    text = (ROOT / "docs/results/core.md").read_text(encoding="utf-8")
    rows = [row for row in _rows(STUDIES / "seeds/differences.csv") if row["quantity"] == "score"]
    clear = sum(float(row["low"]) > 0 or float(row["high"]) < 0 for row in rows)
    changed = f"{clear} change" if clear > 1 else f"{clear} changes"
    assert f"Of {len(rows)} scores, {changed} clearly; chance would change 2 or 3" in text
    assert 2 < 0.05 * len(rows) < 3
    assert "in two of three pairs of runs, `mac_flow` is above it" in text
    for study, again in (("regimes", ""), ("seeds", "-again")):
        pair = {"label": f"vdn{again}", "minus": f"mac_flow{again}"}
        (found,) = (r for r in _rows(STUDIES / study / "core.csv") if pair.items() <= r.items())
        assert round(3 * float(found["probability_of_improvement"])) == 1


def test_what_is_said_of_policies_that_learn_on() -> None:
    page, pages = "results/continuation.md", {}
    for name in (page, "online-learning.md"):
        pages[name] = " ".join((ROOT / "docs" / name).read_text(encoding="utf-8").split())

    def solved(label: str, data: str = "") -> int:
        return round(cell(f"continuation:{label}:{data}:success", STUDIES)[0])

    nav, aisles, shapes = (
        (solved("matd3", f"{task}-medium-replay"), solved(f"from-matd3-{task}"))
        for task in ("coop_nav", "warehouse", "formation")
    )
    anew, *others = (solved(f"anew-{task}") for task in ("coop_nav", "warehouse", "formation"))
    assert f"rise from {nav[0]} to {nav[1]} % success on `coop_nav`" in pages[page]
    assert f"and from {aisles[0]} to {aisles[1]} % on `warehouse`" in pages[page]
    assert f"but fall from {shapes[0]} to {shapes[1]} % on `formation`" in pages[page]
    assert f"new networks reach {anew} % and nothing" in pages[page]
    said = f"solves {nav[1]} % of the episodes of `coop_nav` and {aisles[1]} % of `warehouse`; "
    fall = f"On `formation`, success falls from {shapes[0]} to {shapes[1]} %"
    assert f"{said}from scratch, {anew} % and none. {fall}" in pages["online-learning.md"]
    assert others == [0, 0]


def test_the_sum_over_robots_matters_on_one_dataset_only() -> None:
    text = (ROOT / "docs/results/credit.md").read_text(encoding="utf-8")
    datasets = re.findall(r"^\| `([\w-]+-medium-replay)` \|", text, re.MULTILINE)
    pair, waiting = "vdn:vdn-independent-team-sharp", "intersection-medium-replay"
    found = {
        name: cell(f"regimes/differences:{pair}:{name}:score", STUDIES)[0] for name in datasets
    }
    assert {name for name, change in found.items() if abs(change) > 5} == {waiting}
    own, team = (
        cell(f"regimes:vdn-independent{row}:{waiting}:score", STUDIES)[0]
        for row in ("-sharp", "-team-sharp")
    )
    assert len(found) == 6
    assert "like `vdn` on five of six datasets" in text
    assert f"the sum is worth {found[waiting]:.0f} points" in text
    assert f"own rewards without it {own - team:.0f}.**" in text


def test_the_table_of_the_readme_is_that_of_the_study() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    halves = []
    for label, dataset, value in readme_scores(text):
        is_data = label == "mean of the data"
        mark = f"regimes/data:{dataset}:score" if is_data else f"regimes:{label}:{dataset}:score"
        found, half = cell(mark, STUDIES)
        assert f"{found:.1f}" == value.strip("*"), mark
        halves.append(0.0 if is_data else half)
    assert len(halves) == 20
    assert f"at most\n± {max(halves):.1f}." in text
