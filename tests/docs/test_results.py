"""Numbers of the pages of results are those of the results' files."""

import csv
import re
from pathlib import Path

import pytest

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


def test_the_cost_of_all_studies_is_the_sum_of_their_costs() -> None:
    rows = [
        row
        for file in STUDIES.glob("*/costs.csv")
        for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines())
    ]
    hours = sum(float(row["cpu_seconds"]) for row in rows) / 3600
    text = (ROOT / "docs/results/README.md").read_text(encoding="utf-8")
    assert f"took {hours:.0f} hours of processor time for {len(rows)} combinations" in text


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
