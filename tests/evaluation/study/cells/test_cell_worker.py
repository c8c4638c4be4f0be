"""One cell: done once, the same after any interruption, small when it is done."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, UnknownNameError
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.study.cells.cell_costs import Cost
from swarmdata.evaluation.study.cells.cell_worker import run_cell, run_job
from swarmdata.evaluation.study.cells.cells import (
    COST_FILE,
    DATA_FILE,
    ERROR_FILE,
    RESULTS_FOLDER,
    Cell,
    cells_of,
)
from swarmdata.evaluation.study.cells.study_data import DatasetFacts, digest_of, open_dataset
from swarmdata.evaluation.study.pages import study_folder
from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import run_study
from swarmdata.learn.training.checkpoint import load_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT
from swarmdata.registry.presets import preset
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.recipe import PolicySource
from tests.evaluation.study.conftest import BC, MADDPG, Make, options_in
from tests.support.tiny import make_tiny


def cell_of(study: Study, name: str | None = None) -> Cell:
    found = cells_of(study, digest_of)
    return next(cell for cell in found if name in (None, cell.name))


def returns(folder: Path) -> list[list[float]]:
    files = sorted((folder / RESULTS_FOLDER).glob("*.json"))
    return [load_result(file).evaluation.metrics["return"].tolist() for file in files]


@pytest.mark.slow
def test_a_cell_is_done_once(make_study: Make, tmp_path: Path) -> None:
    cell = cell_of(make_study(curves={"points": 2, "episodes": 2}))
    told: list[int] = []
    assert not cell.is_done(tmp_path / "c")
    run_cell(cell, tmp_path / "c", told.append)
    assert cell.is_done(tmp_path / "c")
    assert sum(told) == cell.n_updates == 20
    assert np.shape(returns(tmp_path / "c")) == (2, 4)
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*") if file.is_file()}
    run_cell(cell, tmp_path / "c", told.append)
    assert {f: f.stat().st_mtime_ns for f in tmp_path.rglob("*") if f.is_file()} == before
    cost = Cost.from_file(tmp_path / "c" / COST_FILE)
    assert cost.attempts[0].updates == 20
    assert cost.cpu_seconds > 0
    assert cost.attempts[0].curve_seconds > 0
    facts = DatasetFacts.from_file(tmp_path / "c" / DATA_FILE)
    assert (facts.id, facts.digest) == ("coop_nav-tiny-v0", cell.digest)
    tensors, metadata = load_checkpoint(cell.run_in(tmp_path / "c") / CHECKPOINT)
    assert not any("adam" in name for name in tensors), "a finished run is small"
    assert metadata["update"] == 20


@pytest.mark.slow
def test_a_cell_learns_from_its_rewards_and_is_measured_by_the_tasks(
    make_study: Make, tmp_path: Path
) -> None:
    rows = {"m": MADDPG, "other": {**MADDPG, "rewards": {"progress": 0.0, "time": 9.0}}}
    found = {cell.label: cell for cell in cells_of(make_study(algorithms=rows), digest_of)}
    losses = {}
    for label, cell in found.items():
        run_cell(cell, tmp_path / label)
        losses[label] = (cell.run_in(tmp_path / label) / "losses.csv").read_text()
    assert losses["m"] != losses["other"]
    facts = [(tmp_path / label / DATA_FILE).read_text() for label in found]
    assert facts[0] == facts[1], "the data's returns are of the recorded rewards"
    results = [
        load_result(next((tmp_path / label / RESULTS_FOLDER).glob("*.json"))) for label in found
    ]
    assert results[0].spec == results[1].spec
    assert [each.provenance.changes.get("rewards") for each in results] == [
        None, {"progress": 0.0, "time": 9.0}
    ]  # fmt: skip
    assert found["other"].conflict(tmp_path / "other") is None
    weaker = found["other"].model_copy(update={"rewards": {"time": 9.0}})
    assert "rewards" in str(weaker.conflict(tmp_path / "other"))


@pytest.mark.slow
def test_a_cell_learns_from_a_mixture(
    make_study: Make, data: Path, other_data: Path, tmp_path: Path
) -> None:
    def mixed(*weights: float, **changes: Any) -> Cell:
        parts = dict(zip((str(data), str(other_data)), weights, strict=True))
        return cell_of(make_study(datasets=["both"], mixtures={"both": parts}, **changes))

    cell = mixed(3, 1)
    assert (cell.data, cell.name) == ("both", "bc/both")
    assert mixed(6, 2).key == cell.key != mixed(1, 3).key
    run_cell(cell, tmp_path / "c")
    result = load_result(next((tmp_path / "c" / RESULTS_FOLDER).glob("*.json")))
    used = result.provenance.changes["mixture"]
    assert [(part["id"], part["weight"]) for part in used] == [
        ("coop_nav-tiny-v0", 0.75), ("coop_nav-other-v0", 0.25)
    ]  # fmt: skip
    facts = DatasetFacts.from_file(tmp_path / "c" / DATA_FILE)
    assert facts.id == result.provenance.dataset_key
    parts = [DatasetFacts.of(Dataset.open(path)) for path in (data, other_data)]
    expected = 0.75 * parts[0].figures.mean_return + 0.25 * parts[1].figures.mean_return
    assert facts.figures.mean_return == pytest.approx(expected)
    assert facts.train_steps == sum(each.train_steps for each in parts)
    again = mixed(3, 1).model_copy(update={"digest": "0" * 64})
    with pytest.raises(SchemaError, match=r"both has digest .*, the study expects 000000000000"):
        run_cell(again, tmp_path / "d")


@pytest.mark.slow
def test_sides_learn_from_their_rows_and_play_against_others(
    make_study: Make, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = preset("tag").with_updates(horizon=40)
    evader = PolicySource(label="evader", name="random")
    team = (PolicySource(label="a", name="scripted", opponents=(evader,)),)
    data = make_tiny(tmp_path / "tag-tiny-v0", id="tag-tiny-v0", spec=spec, policies=team)
    sides = {"pursuers": "scripted", "evader": "tag-greedy"}
    study = make_study(datasets=[str(data)], algorithms={"bc": BC}, sides=sides)
    options = options_in(tmp_path)
    run_study(study, options, "")
    for side, opponents in sides.items():
        folder = tmp_path / "work" / "cells" / "bc" / f"tag-tiny-v0-{side}"
        result = load_result(next((folder / RESULTS_FOLDER).glob("*.json")))
        own = Dataset.open(data).side(side)
        assert result.spec == SideSpec(whole=spec, side=side, opponents=opponents)
        facts = DatasetFacts.from_file(folder / DATA_FILE)
        assert facts.id == result.provenance.dataset_key == f"tag-tiny-v0@{side}"
        assert facts.figures.mean_return == pytest.approx(own.episodes.team_return.mean())
    with (options.out / "results.csv").open() as file:
        seen = {(row["dataset"], row["task"]) for row in csv.DictReader(file)}
    assert seen == {(f"tag-tiny-v0@{k}", f"tag: {k} against {v}") for k, v in sides.items()}
    monkeypatch.setattr(study_folder, "fits_on_a_screen", lambda n_rows, n_lines: False)
    rewrite_pages(options.out)  # as one of many rows, without a mean of the data to compare with
    for changed, message in (
        ({"pursuers": "scriptd"}, "Did you mean 'scripted'"),
        ({"pursuer": "scripted"}, "Did you mean 'pursuers'"),
    ):
        cell = cell_of(make_study(datasets=[str(data)], sides=changed))
        with pytest.raises(UnknownNameError, match=message):
            run_cell(cell, tmp_path / message)
        assert not cell.run_in(tmp_path / message).exists()


class KilledError(BaseException):
    """Stands for a signal."""


@pytest.mark.slow
def test_a_killed_cell_goes_on_to_the_same_numbers(make_study: Make, tmp_path: Path) -> None:
    cell, seen = cell_of(make_study(algorithms={"m": {**MADDPG, "updates": 20}})), 0

    def die(updates: int) -> None:
        nonlocal seen
        seen += updates
        if seen >= 12:
            raise KilledError

    with pytest.raises(KilledError):
        run_cell(cell, tmp_path / "killed", die)
    assert not cell.is_done(tmp_path / "killed")
    for name in ("killed", "whole"):
        run_cell(cell, tmp_path / name)
    assert returns(tmp_path / "killed") == returns(tmp_path / "whole")
    losses = [(cell.run_in(tmp_path / n) / "losses.csv").read_text() for n in ("killed", "whole")]
    assert losses[0] == losses[1]


def test_a_folder_of_another_cell_is_refused(make_study: Make, tmp_path: Path) -> None:
    one, other = (cell_of(make_study(episodes=n)) for n in (4, 5))
    run_cell(one, tmp_path / "c")
    assert one.conflict(tmp_path / "c") is None
    assert other.conflict(tmp_path / "c") == "n_episodes is 4, not 5"
    with pytest.raises(BuildError, match="holds another bc/coop_nav-tiny-v0: n_episodes is"):
        run_cell(other, tmp_path / "c")


def test_failures_are_written_beside_the_cell(make_study: Make, tmp_path: Path) -> None:
    cell = cell_of(make_study()).model_copy(update={"config": {"n_updates": 5, "hiden": [8]}})
    payload = {"cell": json.loads(cell.to_json()), "folder": str(tmp_path / "c")}
    with pytest.raises(BuildError, match=r"UnknownNameError: .*'hiden'"):
        run_job(payload, lambda amount: None)
    assert "Traceback" in (tmp_path / "c" / ERROR_FILE).read_text()


def test_first_episodes_are_a_dataset_of_their_own(data: Path) -> None:
    whole, part = open_dataset(str(data)), open_dataset(str(data), 100)
    assert part.id == "coop_nav-tiny-100-v0"
    assert part.n_steps >= 100 > part.n_steps - part.episodes.lengths[-1]
    assert part.digest == open_dataset(str(data), 100).digest != whole.digest
    assert part.episodes.seeds.tolist() == whole.episodes.seeds[: len(part)].tolist()
    with pytest.raises(SchemaError, match="but the study asks for its first 9,999"):
        open_dataset(str(data), 9999)
