"""Bold numbers of the README and of the page of regimes are the best ones, and no others."""

from pathlib import Path

import pytest

from swarmdata.evaluation.study.pages.cell_archive import read_archive
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard
from swarmdata.evaluation.study.plan import Study
from tests.docs.marked_numbers import MARK, readme_scores

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
REGIMES = ROOT / "cards/studies/regimes"

Leaders = dict[str, set[str]]


@pytest.fixture(scope="module")
def leaders(tmp_path_factory: pytest.TempPathFactory) -> Leaders:
    """Dataset -> the best algorithm and those not clearly worse, ablations apart."""
    study = Study.from_file(REGIMES / "study.yaml")
    found, _ = read_archive(study, REGIMES / "cells.tar.xz", tmp_path_factory.mktemp("cells"))
    families = {
        label: each.family for label, each in study.algorithms.items() if each.family != "ablations"
    }
    board = make_scoreboard(found.results, families, "score")
    return {name.removesuffix("-v1"): {*board.leaders(name)} for name in board.estimates}


def test_those_of_the_page_of_regimes(leaders: Leaders) -> None:
    page = (ROOT / "docs/results/data-regimes.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    checked = 0
    for match in MARK.finditer("\n".join(rows)):
        study, label, dataset, *_ = match[3].split(":")
        if study == "regimes":
            assert ("**" in match[0]) == (label in leaders[dataset]), match[0]
            checked += 1
    assert checked == 4 * len(rows)


def test_those_of_the_readme(leaders: Leaders) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    cells = [each for each in readme_scores(text) if each[0] != "mean of the data"]
    assert len(cells) == 16
    for label, dataset, cell in cells:
        assert ("**" in cell) == (label in leaders[dataset]), (label, dataset)
