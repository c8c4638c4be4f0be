"""Algorithms that learn in the task, beside those that learn from its data."""

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")

import swarmdata
from swarmdata.evaluation.study.answers.write_answers import write_answers
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC

TINY = {"n_copies": 2, "rollout_steps": 16, "minibatch": 32, "n_epochs": 1, "hidden": 8}


@pytest.mark.usefixtures("here", "empty_figures")
def test_online_rows_stand_beside_the_offline_ones_of_their_task(
    make_study: Callable[..., Study], data: Path, tmp_path: Path
) -> None:
    task = tmp_path / "nav.yaml"
    task.write_text(swarmdata.load(data).task.to_yaml())
    online = {"learned": {"algorithm": "mappo", "task": str(task), "frames": 64, "settings": TINY}}
    study = make_study(algorithms={"bc": BC}, online=online)
    options = StudyOptions(tmp_path / "studies/tiny", tmp_path / "work", progress=False)
    failures, _ = run_study(study, options, "x")
    assert not failures
    out = tmp_path / "results"
    write_answers(tmp_path / "studies", out)
    page = (out / "online.md").read_text()
    assert "On coop_nav, the return of `learned (online)`, which learns in the task, is " in page
    assert ", that of `bc` from coop_nav-tiny " in page
    assert "- On coop_nav, of the algorithms that learn in the task, `learned (online)`" in page
    assert " after 64 joint steps; of those that learned from coop_nav-tiny it is `bc`" in page
    assert "\n| `learned (online)` | 2 | 64 joint steps | " in page
    assert "\n| `bc` | 2 | coop_nav-tiny | " in page
    assert "![return by task](online-tiny.png)" in page
    assert "Percentage points gained in the last fifth: `learned` +0.0." in page
    assert {file.name for file in out.glob("*.png")} == {
        "online-tiny.png",
        "online-tiny-curves.png",
    }
    assert not (out / "data-regimes.md").exists()
