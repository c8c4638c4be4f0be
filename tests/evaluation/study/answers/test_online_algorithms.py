"""Algorithms that learn in the task, beside those that learn from its data."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="a study needs the torch extra")

import swarmdata
from swarmdata.evaluation.study.answers import online_algorithms
from swarmdata.evaluation.study.answers.evidence import open_evidence
from swarmdata.evaluation.study.answers.write_answers import write_answers
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.evaluation.study.conftest import BC

TINY = {"n_copies": 2, "rollout_steps": 16, "minibatch": 32, "n_epochs": 1, "hidden": 8}


@pytest.fixture
def online(data: Path, tmp_path: Path) -> dict[str, Any]:
    """A row that learns in the task of the tiny dataset."""
    task = tmp_path / "nav.yaml"
    task.write_text(swarmdata.load(data).task.to_yaml())
    return {"learned": {"algorithm": "mappo", "task": str(task), "frames": 64, "settings": TINY}}


@pytest.mark.usefixtures("here", "empty_figures")
def test_online_rows_stand_beside_the_offline_ones_of_their_task(
    make_study: Callable[..., Study], online: dict[str, Any], tmp_path: Path
) -> None:
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


@pytest.mark.usefixtures("here", "empty_figures")
@pytest.mark.parametrize(
    ("labels", "shown"), [(["learned"], ["mappo"]), (["one", "other"], ["one", "other"])]
)
def test_curves_are_those_of_algorithms_and_of_rows_where_one_has_several(
    make_study: Callable[..., Study],
    online: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    labels: list[str],
    shown: list[str],
) -> None:
    rows = dict.fromkeys(labels, online["learned"])
    study = make_study(algorithms={"bc": BC}, online=rows, seeds=[0])
    options = StudyOptions(tmp_path / "studies/tiny", tmp_path / "work", progress=False)
    run_study(study, options, "x")
    drawn = []
    monkeypatch.setattr(
        online_algorithms,
        "plot_training_curves",
        lambda panels, looks, *_, **__: drawn.append((panels, looks)),
    )
    with open_evidence(tmp_path / "studies") as (evidence, _):
        online_algorithms.answer_online_algorithms(evidence, tmp_path)
    ((panels, looks),) = drawn
    assert [list(curves) for curves in panels.values()] == [shown]
    assert list(looks) == shown


@pytest.mark.usefixtures("here", "empty_figures")
def test_rows_that_learn_with_other_sensors_stand_among_the_views_of_the_data(
    make_study: Callable[..., Study], online: dict[str, Any], data: Path, tmp_path: Path
) -> None:
    seen = {
        "datasets": [str(data)],
        "algorithms": ["bc"],
        "views": {"recorded": {}, "near": {"observation": "state-1"}},
        "online": ["learned"],
    }
    study = make_study(algorithms={"bc": BC}, online=online, information=seen)
    options = StudyOptions(tmp_path / "studies/tiny", tmp_path / "work", progress=False)
    failures, (report, *_) = run_study(study, options, "x")
    assert not failures
    names = {path.name for path in tmp_path.glob("work/cells/learned/*")}
    assert {"nav", "nav~state-1"} <= names
    section = report.read_text().partition("## Information: trained and evaluated")[2]
    row = next(line for line in section.splitlines() if line.startswith("| `learned (online)`"))
    assert "–" not in row.strip("| ").split(" | ")[1:3], "an estimate in both views"
    assert "near" not in report.read_text().partition("## Information")[0]
    _, left_out = write_answers(tmp_path / "studies", tmp_path / "results")
    page = (tmp_path / "results/information.md").read_text()
    assert "\n| view | `bc` | `learned (online)` |\n" in page
    assert "with `near` instead of `recorded`, the return of " in page
    assert " of 2 algorithms " in page
    assert "**In short:** On coop_nav-tiny-v0 and in its task, the best return is " in page
    assert "online.md" in left_out, "the study asks what information costs"
