"""Reports and tables of the committed studies are what their episodes give."""

import shutil
from pathlib import Path

import pytest

from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from tests.support.pairs import slow

STUDIES = Path(__file__).parents[4] / "cards/studies"
TABLES = ("report.md", "estimates.csv", "differences.csv", "views.csv")
HIGHEST = 1200  # pixels: a screen


def _is_made_again(study: Path, folder: Path) -> None:
    again = Path(shutil.copytree(study, folder / study.name))
    present = [name for name in TABLES if (study / name).exists()]
    for name in present[1:]:
        (again / name).unlink()
    rewrite_pages(again)
    for name in present:
        assert (again / name).read_text() == (study / name).read_text(), study.name


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("study", ["noise", "safe", *slow("hearing")])
def test_a_committed_report_is_what_its_episodes_give(study: str, tmp_path: Path) -> None:
    _is_made_again(STUDIES / study, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("plan", sorted(STUDIES.glob("*/study.yaml")), ids=lambda p: p.parent.name)
def test_every_committed_report_is_what_its_episodes_give(plan: Path, tmp_path: Path) -> None:
    _is_made_again(plan.parent, tmp_path)


def test_a_committed_figure_is_no_higher_than_a_screen() -> None:
    for file in sorted(STUDIES.glob("**/*.png")):
        header = file.read_bytes()[:24]
        assert int.from_bytes(header[20:24], "big") <= HIGHEST, file
