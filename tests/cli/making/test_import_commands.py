"""The commands for recordings, and those that take a recording's folder."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.record import Recorder
from tests.record.worlds import Counting, play, steady
from tests.support.command_line import run

ID = "counting_v1-mine-v0"


@pytest.fixture
def unfinished(tmp_path: Path) -> Path:
    recorder = Recorder(Counting(), id=ID, path=tmp_path / "ds", policies=("a", "b"))
    play(recorder, 12, steady)
    recorder.pause()
    return tmp_path / "ds"


def test_an_unfinished_recording_is_shown_and_finished(unfinished: Path) -> None:
    shown = run("record", "show", str(unfinished))
    assert f"id: {ID}" in shown
    assert "policy a: 12 episodes, 48 joint steps" in shown
    assert "policy b: 0 episodes" in shown
    assert "12 episodes, 48 joint steps, digest" in run("record", "recover", str(unfinished))
    assert len(Dataset.open(unfinished)) == 12
    assert "is finished already" in run("record", "show", str(unfinished), code=1)


def test_other_commands_take_the_folder(
    unfinished: Path, tmp_path: Path, cache_folder: Path
) -> None:
    pytest.importorskip("torch")
    run("record", "recover", str(unfinished))
    assert "## Environment" in run("card", str(unfinished))
    assert "all files match the manifest" in run("verify", str(unfinished))
    options = ("--updates", "3", "--seeds", "1", "--set", "batch_size=8", "--set", "hidden=8")
    out = str(tmp_path / "run")
    run("train", "bc", str(unfinished), "--out", out, *options)
    assert (tmp_path / "run" / "checkpoint.safetensors").exists()
    (cache_folder / "datasets").mkdir()
    unfinished.rename(cache_folder / "datasets" / ID)
    run("train", "bc", ID, "--out", str(tmp_path / "other"), *options)
    assert "SpecError" in run(
        "train", "bc", ID, "--observation", "lidar", "--out", out, *options, code=1
    )
