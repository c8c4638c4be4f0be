"""`swarmdata convert`: there and back, and what it says when something is missing."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.synthetic import make_dataset
from tests.support import command_line

run = partial(command_line.run, "convert")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("convert") / "ds"
    make_dataset(path, [[4, 3, 5, 2] * 5], n_steps=60)
    return path


def test_there_and_back(record: Callable[..., Path], tmp_path: Path) -> None:
    folder, there = record(tmp_path / "ds", TaskSpec(horizon=50), ("random",)), tmp_path / "x.hdf5"
    assert run(folder, there, "--to", "d4rl").strip() == str(there)
    take = (there, tmp_path / "back", "--from", "d4rl", "--id", "coop_nav-back-v0")
    out = run(*take, "--note", "license=mit")
    back, ours = Dataset.open(tmp_path / "back"), Dataset.open(folder)
    assert back.digest[:8] in out
    np.testing.assert_array_equal(
        back.transitions()["observations"], ours.transitions()["observations"]
    )
    assert "| license | mit |" in back.card
    assert "keeps the split it had in the source" in back.card
    assert audit(back.path, progress=False).problems == ()
    assert back.recipe.metadata["license"] == "mit"  # type: ignore[index]


def test_answers_are_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "x.hdf5"
    with h5py.File(path, "w") as file:
        file["observations"] = np.arange(240.0).reshape(60, 4)
        file["actions"] = np.zeros((60, 2))
        file["rewards"] = np.zeros(60)
        file["terminals"] = np.zeros(60, bool)
    take = (path, tmp_path / "out", "--from", "d4rl", "--id", "maze-theirs-v0")
    assert "does not say which episodes" in run(*take, code=1)
    answers = ("--time-limit", "3", "--final", "cut", "--agents", "red,blue", "--agents", "2")
    run(*take, *answers, "--action-bounds=-1,1")
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.episodes.lengths.tolist() == [2] * 20
    assert dataset.spec.n_agents == 2
    assert dataset.spec.agents[0].action.high == 1.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ([], "either --to"),
        (["--to", "d4rl", "--from", "d4rl"], "either --to"),
        (["--from", "d4rl"], "required with --from"),
        (["--from", "d4rl", "--id", "a-b-v0", "--action-bounds", "1"], "expected two numbers"),
        (["--from", "d4rl", "--id", "a-b-v0", "--note", "x"], "got 'x', expected KEY=VALUE"),
    ],
)
def test_wrong_options(folder: Path, tmp_path: Path, options: list[str], problem: str) -> None:
    assert problem in run(folder, tmp_path / "x", *options, code=2)
