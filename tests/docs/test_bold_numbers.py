"""Bold numbers of the README and of the page of regimes are the best ones, and no others.

So are those that the page of the core counts.
"""

import csv
import re
from collections import Counter
from pathlib import Path

import pytest

from swarmdata.evaluation.study.pages.cell_archive import read_archive
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard
from swarmdata.evaluation.study.plan import Study
from tests.docs.marked_numbers import MARK, readme_scores

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
REGIMES = ROOT / "cards/studies/regimes"

Leaders = dict[str, set[str]]


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    study = Study.from_file(REGIMES / "study.yaml")
    return read_archive(study, REGIMES / "cells.tar.xz", tmp_path_factory.mktemp("cells"))[0]


def leaders_of(found: Findings, families: dict[str, str]) -> Leaders:
    """Dataset -> the best of these algorithms and those not clearly worse."""
    board = make_scoreboard(found.results, families, "score")
    return {name.removesuffix("-v1"): {*board.leaders(name)} for name in board.estimates}


@pytest.fixture(scope="module")
def leaders(findings: Findings) -> Leaders:
    """Those of all algorithms, ablations apart."""
    algorithms = findings.study.algorithms.items()
    families = {label: each.family for label, each in algorithms if each.family != "ablations"}
    return leaders_of(findings, families)


def test_those_of_the_page_of_regimes(leaders: Leaders) -> None:
    page = (ROOT / "docs/results/data-regimes.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    checked = 0
    for match in MARK.finditer("\n".join(rows)):
        study, label, dataset, *_ = match[3].split(":")
        if study == "regimes":
            assert ("**" in match[0]) == (label in leaders[dataset]), match[0]
            checked += 1
    assert checked == 4 * len(rows) + 8  # `matd3` is not on all


def test_those_of_the_readme(leaders: Leaders) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    cells = [each for each in readme_scores(text) if each[0] != "mean of the data"]
    assert len(cells) == 16
    for label, dataset, cell in cells:
        assert ("**" in cell) == (label in leaders[dataset]), (label, dataset)


def test_the_page_of_the_core_counts_them(findings: Findings) -> None:
    """As the framed cells of its figure do, among the rows that are on all of the core."""
    with (REGIMES / "core.csv").open(encoding="utf-8", newline="") as text:
        on_all = {row["label"]: "" for row in csv.DictReader(text)}
    leaders = leaders_of(findings, on_all)
    counts = Counter(label for name in findings.study.core for label in leaders[name])
    page = (ROOT / "docs/results/core.md").read_text(encoding="utf-8")
    head, _, *rows = page[page.index("| algorithm |") :].partition("\n\n")[0].splitlines()
    column = re.split(r" *\| *", head).index("best, or not clearly worse, on")
    shown = [re.split(r" *\| *", row) for row in rows]
    assert {each[1].strip("`"): int(each[column]) for each in shown} == {
        each[1].strip("`"): counts[each[1].strip("`")] for each in shown
    }
