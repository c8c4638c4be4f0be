"""The command, and a cell that is run again to check it: what is the same, what differs."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import swarmdata
from swarmdata.errors import StudyError
from swarmdata.evaluation.study.cells.cells import RESULTS_FOLDER, cells_of
from swarmdata.evaluation.study.cells.run_cells import run_cells
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.evaluation.study.run_study import StudyOptions, reproduce_cell, run_study
from swarmdata.learn.training.run_files import read_table
from tests.evaluation.study.conftest import BC, Make
from tests.support.command_line import run

pytestmark = pytest.mark.usefixtures("here")


def change_first_value(folder: Path, metric: str, change: Callable[[Any], Any]) -> None:
    """Changes the first episode's metric in the first result of a cell."""
    file = sorted((folder / RESULTS_FOLDER).glob("*.json"))[0]
    content = json.loads(file.read_text())
    content["metrics"][metric][0] = change(content["metrics"][metric][0])
    file.write_text(json.dumps(content))


@pytest.mark.slow
def test_a_cell_done_again_is_the_same_and_a_changed_one_is_not(
    make_study: Make, tmp_path: Path
) -> None:
    (cell, *_) = cells_of(make_study(), digest_of)
    folder = cell.folder(tmp_path)
    with pytest.raises(StudyError, match="is not finished"):
        reproduce_cell(folder, progress=False)
    run_cells([cell], tmp_path, progress=False)
    same = reproduce_cell(folder, progress=False)
    assert same.is_same
    assert "all losses are the same" in same.sentence()
    change_first_value(folder, "return", lambda value: value + 0.5)
    other = reproduce_cell(folder, progress=False)
    assert (other.n_different, other.largest_difference) == (1, 0.5)
    assert other.first_differing_update is None
    assert "1 of " in other.sentence()
    assert "losses are equal" in other.sentence()
    before, now = other.mean_returns
    assert before - now == pytest.approx(0.5 / (cell.n_episodes * len(cell.seeds)))
    change_first_value(folder, "time_to_goal", lambda time: 1.5 if time is None else None)
    other = reproduce_cell(folder, progress=False)
    assert (other.n_different, other.largest_difference, other.n_one_sided) == (2, 0.5, 1)
    assert "by at most 0.5 (only one run defines 1 of them)" in other.sentence()
    shutil.rmtree(cell.run_in(folder))  # as in a cell that was unpacked from an archive
    assert "losses were not kept" in reproduce_cell(folder, progress=False).sentence()


def test_the_command_writes_checks_and_refuses(make_study: Make, tmp_path: Path) -> None:
    file, folders = tmp_path / "study.yaml", ("--work", tmp_path / "w")
    out = tmp_path / "tiny"  # beside the plan
    file.write_text(make_study(algorithms={"bc": BC}, seeds=[0]).to_yaml())
    assert str(out / "report.md") in run("study", file, *folders)
    check = ("study", file, *folders, "--check", "bc/coop_nav-tiny-v0")
    assert "values and all losses are the same" in run(*check)
    shutil.rmtree(tmp_path / "w")
    assert "values are the same" in run(*check)  # as those in the archive
    (out / "cells.tar.xz").unlink()
    assert "bc/coop_nav-tiny-v0 is not finished" in run(*check, code=1)
    assert str(out / "report.md") in run("study", file, *folders)
    assert str(out / "report.md") in run("study", out)
    assert "--only: it has no effect" in run("study", out, "--only", "bc/*", code=2)
    file.write_text(make_study(algorithms={"bc": BC}, seeds=[0], episodes=3).to_yaml())
    assert "--again to delete these cells" in run("study", file, *folders, code=1)
    file.write_text(f"{file.read_text()}seed: 1\n")
    assert "Did you mean 'seeds'" in run("study", file, *folders, code=1)


def test_an_online_row_alone_is_done_before_there_is_a_page(
    make_study: Make, data: Path, tmp_path: Path
) -> None:
    task, file = tmp_path / "nav.yaml", tmp_path / "study.yaml"
    task.write_text(swarmdata.load(data).task.to_yaml())
    settings = {"n_copies": 2, "rollout_steps": 16, "minibatch": 32, "n_epochs": 1, "hidden": 8}
    online = {"algorithm": "mappo", "task": str(task), "frames": 64, "settings": settings}
    file.write_text(make_study(online={"learned": online}, seeds=[0]).to_yaml())
    folders = ("--out", tmp_path / "o", "--work", tmp_path / "w")
    assert "no page yet" in run("study", file, "--only", "learned/*", *folders)
    assert "done  learned/" in run("study", file, "--cells", *folders[2:])


@pytest.mark.slow
def test_an_online_row_begins_with_the_policies_of_an_offline_run(
    make_study: Make, options: StudyOptions, tmp_path: Path
) -> None:
    settings = {"n_copies": 2, "rollout_steps": 16, "batch_size": 8}
    row = {"algorithm": "maddpg", "task": "coop_nav", "frames": 64, "settings": settings}
    begun = row | {"start": "zoo:bc/coop_nav-expert"}
    study = make_study(online={"begun": begun, "fresh": row}, seeds=[0])
    assert run_study(study, options, "x")[0] == {}
    runs = {name: tmp_path / "work/cells" / name / "coop_nav" / name for name in study.online}
    first = {name: read_table(run / "curve.csv")[0]["success"] for name, run in runs.items()}
    assert first["begun"] > 0.9 > first["fresh"]
