"""Policies of a study in tasks that they were not trained in: larger teams, other places."""

import shutil
from pathlib import Path

import pytest

from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC, Make, rows_below

pytestmark = pytest.mark.usefixtures("here")

MAP = Path(__file__).parents[4] / "cards/maps/rooms.map"
SETS = {**BC, "settings": {"policy_network": "deep_sets"}}


@pytest.mark.slow
def test_rows_are_evaluated_in_other_tasks_if_their_policies_fit(
    data: Path,
    make_study: Make,
    options: StudyOptions,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    tasks = ["coop_nav-easy", "coop_nav-n8", "rooms"]
    (tmp_path / "rooms.yaml").write_text("map: rooms.map")
    shutil.copy(MAP, tmp_path)
    sources = [*tasks[:2], str(tmp_path / "rooms.yaml")]
    data = shutil.copytree(data, tmp_path / "mine")  # another name than the id of the data
    plan = {"datasets": [str(data)], "algorithms": ["bc", "sets"], "tasks": sources, "episodes": 3}
    both = {"bc": BC, "sets": SETS}
    study = make_study(datasets=[str(data)], algorithms=both, seeds=[0], tasks=plan)
    failures, files = run_study(study, options, "x")
    assert failures == {}
    page = files[0].read_text()
    assert f"| mine: success (%) | {' | '.join(tasks)} |" in page
    rows = rows_below(page, "Other places", "mine: success (%)")
    assert rows["`bc`"][1] == "other inputs"
    assert "other inputs" not in rows["`sets`"]
    kept = {path.relative_to(tmp_path / "work/tasks") for path in tmp_path.glob("work/tasks/*/*/*")}
    assert kept == {
        Path("bc/mine/coop_nav-easy"),
        Path("sets/mine/coop_nav-easy"),
        Path("sets/mine/coop_nav-n8"),
        *(Path(label, "mine/rooms") for label in both),
    }
    again, _ = run_study(study, options, "x")
    assert again == {}
    assert files[0].read_text() == page
    shutil.rmtree(tmp_path / "work/cells/sets/mine/sets")  # as an archive leaves it
    assert run_study(study, options, "x")[0] == {}
    assert "sets/mine has no policies in" in caplog.text


def test_unknown_tasks_are_refused_before_the_training(
    data: Path, make_study: Make, options: StudyOptions, tmp_path: Path
) -> None:
    plan = {"datasets": [str(data)], "algorithms": ["bc"], "tasks": ["coop_nev"]}
    with pytest.raises(UnknownNameError, match="coop_nev"):
        run_study(make_study(tasks=plan), options, "x")
    assert not (tmp_path / "work").exists()
