"""Reports and tables of the committed studies are what their episodes give."""

import shutil
from pathlib import Path

import pytest

from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from tests.support.pairs import slow

STUDIES = Path(__file__).parents[4] / "cards/studies"
ALL = {plan.parent.name for plan in STUDIES.glob("*/study.yaml")}
TABLES = ("report.md", "estimates.csv", "differences.csv", "views.csv")
HIGHEST = 1200  # pixels: a screen


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("name", ["noise", "safe", *slow(*sorted(ALL - {"noise", "safe"}))])
def test_a_committed_report_is_what_its_episodes_give(name: str, tmp_path: Path) -> None:
    study, again = STUDIES / name, Path(shutil.copytree(STUDIES / name, tmp_path / name))
    present = [file for file in TABLES if (study / file).exists()]
    for file in present[1:]:
        (again / file).unlink()
    rewrite_pages(again)
    for file in present:
        assert (again / file).read_text() == (study / file).read_text()


def test_a_committed_figure_is_no_higher_than_a_screen() -> None:
    for file in sorted(STUDIES.glob("**/*.png")):
        header = file.read_bytes()[:24]
        assert int.from_bytes(header[20:24], "big") <= HIGHEST, file
