"""Views of a study's data: each is trained and evaluated, and policies are tried in the others."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, collect_study, run_study
from tests.evaluation.study.conftest import BC, Make, options_in, rows_below, work_here

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("here")]

VIEWS = {
    "recorded": {},
    "noisy": {"observation": "state+noise-0.2"},
    "lidar": {"observation": "lidar"},
}


@pytest.fixture(scope="module")
def study(data: Path, make_study: Make) -> Study:
    plan = {
        "datasets": [str(data)],
        "algorithms": ["bc"],
        "views": VIEWS,
        "transfer": ["bc"],
        "transfer_episodes": 3,
    }
    return make_study(algorithms={"bc": BC}, seeds=[0], information=plan)


@pytest.fixture(scope="module")
def trained(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `out` and `work` of the study's cells; none was tried in other views."""
    folder = tmp_path_factory.mktemp("trained")
    with pytest.MonkeyPatch.context() as patch:
        work_here(patch)
        assert run_study(study, options_in(folder, only="bc/*"), "x")[0] == {}
    return folder


@pytest.fixture
def options(trained: Path, tmp_path: Path) -> StudyOptions:
    """Of a copy of that folder."""
    shutil.copytree(trained, tmp_path, dirs_exist_ok=True)
    return options_in(tmp_path)


def test_each_view_is_a_column_and_transfer_a_matrix(
    study: Study, options: StudyOptions, tmp_path: Path
) -> None:
    failures, files = run_study(study, options, "x")
    assert failures == {}
    page = files[0].read_text()
    title = "Information: trained and evaluated with it"
    seen = rows_below(page, title, "coop_nav-tiny-v0: return")
    assert len(seen["`bc`"]) == 3
    assert len(set(seen["`bc`"])) == 3  # views differ
    models = rows_below(page, title, "view")
    assert models["`noisy`"] == ["state+noise-0.2", "as recorded"]
    moved = rows_below(page, "Information: learned with one, used with another", "learned with")
    assert moved["`lidar`"][:2] == ["other inputs"] * 2
    assert moved["`recorded`"][2] == "other inputs"
    assert moved["`recorded`"][0] != moved["`recorded`"][1]
    assert {path.name for path in tmp_path.glob("work/transfer/bc/*/*")} == set(VIEWS)
    assert (tmp_path / "out" / "information.png").exists()
    recorded = (tmp_path / "out" / "results.csv").read_text()
    assert "@" not in recorded, "the grid stays as recorded"
    again, _ = run_study(study, options, "x")
    assert again == {}
    assert files[0].read_text() == page


def test_finished_cells_are_tried_in_other_views_when_that_is_asked_for(
    study: Study, options: StudyOptions, tmp_path: Path
) -> None:
    title, page = "## Information: learned with one, used with another", options.out / "report.md"
    assert title not in page.read_text()
    shutil.rmtree(tmp_path / "work/cells/bc/coop_nav-tiny-v0~lidar")  # not finished
    run_study(study, replace(options, shifts_only=True), "x")
    section = page.read_text().partition(title)[2].partition("\n## ")[0]
    assert "`noisy`" in section
    assert "lidar" not in section
    assert not (tmp_path / "work/cells/bc/coop_nav-tiny-v0~lidar").exists()
    collect_study(study, options, "x")
    assert page.read_text().partition(title)[2].partition("\n## ")[0] == section
    rewrite_pages(tmp_path / "out")
    assert page.read_text().partition(title)[2].partition("\n## ")[0] == section
