"""Sweeps of a study: of the best of each family, trained on what the sweep takes away."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.study.run_study import (
    StudyOptions,
    collect_study,
    list_cells,
    run_one_cell,
    run_study,
)
from swarmdata.numerics.random import VALIDATION_BASE
from tests.evaluation.study.conftest import BC, MADDPG, Make

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("here")]


def test_the_best_of_each_family_is_swept(
    data: Path, make_study: Make, options: StudyOptions, tmp_path: Path
) -> None:
    shared = {"dataset": str(data), "points": 2}
    study = make_study(
        algorithms={"bc": BC, "clipped": {**BC, "updates": 1}, "maddpg": MADDPG},
        seeds=[0],
        block="validation",
        sweeps={
            "loss": {**shared, "vary": "communication", "axis": "drop=0,0.5",
                     "communication": "perfect"},
            "noise": {**shared, "vary": "observation", "axis": "noise=0,0.2",
                      "families": ["cloning"]},
        },
    )  # fmt: skip
    grid = [f"{label}/coop_nav-tiny-v0" for label in study.algorithms]
    listed = list_cells(study, options)
    assert [cell.name for cell in listed.cells] == grid
    assert listed.open_sweeps == ("loss", "noise")
    failures, files = run_study(study, options, "x")
    assert failures == {}
    listed = list_cells(study, options)
    swept = [cell for cell in listed.cells if cell.name not in grid]
    assert listed.open_sweeps == ()
    assert len(swept) == 2
    assert all(cell.is_done(cell.folder(options.work_of(study))) for cell in listed.cells)
    assert not run_one_cell(study, swept[0].name, options)
    results = [load_result(each) for each in tmp_path.glob("work/sweeps/*/results/**/*.json")]
    assert min(each.evaluation.seeds.min() for each in results) >= VALIDATION_BASE
    page = files[0].read_text()
    loss, noise = (
        page.partition(f"## Robustness: {axis}")[2].partition("\n## ")[0]
        for axis in ("communication drop", "observation noise")
    )
    assert len(re.findall(r"\| `\w+` \| ", loss)) == 2  # a family each
    assert len(re.findall(r"\| `\w+` \| ", noise)) == 1
    assert "drop 0.5 |" in loss
    assert "communication `perfect`" in loss
    assert "`maddpg`" in loss
    assert "`maddpg`" not in noise
    for label in ("loss", "noise"):
        names = {path.name for path in (tmp_path / "out" / "sweeps" / label).iterdir()}
        assert names == {"sweep.csv"}
    assert (tmp_path / "out" / "robustness.png").exists()
    trained = {path.parent.name for path in tmp_path.glob("work/cells/*/coop_nav-tiny-v0~perfect")}
    assert "maddpg" in trained
    assert len(trained) == 2
    assert "~" not in (tmp_path / "out" / "results.csv").read_text()
    costs = (tmp_path / "out" / "costs.csv").read_text()
    assert costs.count("~perfect") == 2
    assert collect_study(study, options, "x")[0].read_text() == page
    assert (tmp_path / "out" / "costs.csv").read_text() == costs
    shutil.rmtree(tmp_path / "work/cells/maddpg/coop_nav-tiny-v0~perfect")
    page = collect_study(study, options, "x")[0].read_text()
    assert "## Robustness: communication drop" not in page, "a cell of the sweep is gone"
    assert "## Robustness: observation noise" in page


def test_nothing_is_trained_where_only_finished_cells_are_evaluated(
    data: Path, make_study: Make, options: StudyOptions, tmp_path: Path
) -> None:
    plan = {"dataset": str(data), "vary": "communication", "axis": "drop=0,0.5",
            "communication": "perfect"}  # fmt: skip
    study = make_study(algorithms={"bc": BC}, seeds=[0], sweeps={"loss": plan})
    run_one_cell(study, "bc/coop_nav-tiny-v0", options)
    run_study(study, replace(options, shifts_only=True), "x")
    assert [each.name for each in tmp_path.glob("work/cells/*/*")] == ["coop_nav-tiny-v0"]
