"""A recording survives kill -9 at any moment: what was written is there, whole, and it goes on."""

import contextlib
import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import DatasetError, RecipeConflictError
from swarmdata.record import Limits, Recorder, recover
from swarmdata.record.recording_folder import SESSION_FILE, inspect_recording, unfinished_folder
from swarmdata.store import open_store
from swarmdata.store.parts import read_part_table
from swarmdata.testing.synthetic import make_dataset
from tests.record.worlds import Counting, play, steady
from tests.support.at_once import Forked
from tests.support.interpreter import python

ROOT = Path(__file__).parents[2]
ID = "counting_v1-mine-v0"
N_EPISODES = 400


def record_all(path: str) -> None:
    """Records in parts of two episodes, and says how many there are."""
    recorder = Recorder(Counting(), id=ID, path=path, limits=Limits(episodes=2))
    print("ready", flush=True)
    while recorder.n_episodes < N_EPISODES:
        play(recorder, 1, steady)
        print(recorder.n_episodes, flush=True)
    recorder.close()


def finish(path: str) -> None:
    """Makes a dataset of an interrupted recording."""
    print("ready", flush=True)
    recover(path)


def run_and_kill(
    work: Callable[[str], None], path: Path, delay: float
) -> tuple[int | None, list[str]]:
    """Kills a process so many seconds after it is ready; its exit code and its lines."""
    running = Forked(path, work=work)
    running.wait_for(lambda out, err: out.startswith("ready\n"))
    time.sleep(delay)
    with contextlib.suppress(ProcessLookupError):
        os.kill(running.pid, signal.SIGKILL)
    code, out, _ = running.end()
    return code, out.splitlines()


def check_whole(dataset: Dataset) -> None:
    """Every episode is as `Counting` plays it, and every byte as it was written."""
    open_store(dataset.path, "full")
    for episode in dataset:
        assert len(episode) == 4
        np.testing.assert_array_equal(episode.rewards, np.arange(1, 5)[:, None] * np.ones(2))
        assert (episode.observations[:, :, 0] == episode.seed % 1000).all()
    assert len(set(dataset.episodes.seeds.tolist())) == len(dataset)


def test_kill_while_recording(tmp_path: Path) -> None:
    """Row 01: what is lost is the part that was not on the disk yet."""
    path, rng, survived = tmp_path / "ds", random.Random(0), 0
    for _ in range(2):
        returned, lines = run_and_kill(record_all, path, rng.uniform(0.0, 0.15))
        assert returned == -signal.SIGKILL
        told = [int(line) for line in lines if line.isdecimal()]
        is_begun = (unfinished_folder(path) / SESSION_FILE).exists()  # else it was killed before
        ((_, found, _),) = inspect_recording(path).policies if is_begun else ((0, 0, 0),)
        assert found >= survived, "what was written is never lost"
        assert found >= max(told, default=0) - 2, "only the running part is"
        survived = found
    with pytest.raises(DatasetError):
        open_store(path)  # nothing half-made is to be seen
    recorder = Recorder(Counting(), id=ID, path=path)
    assert recorder.n_episodes == survived
    play(recorder, 12, steady)
    dataset = recorder.close()
    assert len(dataset) == survived + 12
    check_whole(dataset)
    assert [p.name for p in tmp_path.iterdir()] == ["ds"], "no leftovers"


def interrupted(path: Path, n_episodes: int) -> Path:
    recorder = Recorder(Counting(), id=ID, path=path)
    play(recorder, n_episodes, steady)
    recorder.pause()
    return path


@pytest.mark.slow
def test_kill_while_finishing(tmp_path: Path) -> None:
    """Row 02: the recording is finished by whoever comes next, the same bytes."""
    whole = recover(interrupted(tmp_path / "whole", 60))
    path = interrupted(tmp_path / "ds", 60)
    for delay in (0.0, 0.25):
        returned, _ = run_and_kill(finish, path, delay)
        if returned == 0:
            break
        if path.exists():
            open_store(path, "full")  # published in one rename
        if not unfinished_folder(path).exists():
            break
    dataset = recover(path) if unfinished_folder(path).exists() else Dataset.open(path)
    check_whole(dataset)
    assert dataset.digest == whole.digest
    assert (path / "card.md").exists()


def test_a_process_killed_while_tidying_up_is_forgiven(tmp_path: Path) -> None:
    """Row 02: parts that are left over do no harm."""
    path = interrupted(tmp_path / "ds", 12)
    shutil.copytree(unfinished_folder(path), tmp_path / "kept")
    digest = recover(path).digest
    shutil.copytree(tmp_path / "kept", unfinished_folder(path))
    for part in unfinished_folder(path).glob("part-*"):
        (part / "episodes.npy").unlink()
    (path / "card.md").unlink()
    assert recover(path).digest == digest
    assert (path / "card.md").exists()
    other = interrupted(tmp_path / "other", 12)
    make_dataset(other, [[3] * 40], n_steps=60)
    with pytest.raises(RecipeConflictError, match="holds another dataset"):
        recover(other)


@pytest.mark.slow
def test_a_script_that_ends_without_closing_loses_nothing(tmp_path: Path) -> None:
    """Row 01: finished episodes are written when the interpreter ends."""
    code = f"""
import sys
from swarmdata.record import Recorder
from tests.record.worlds import Counting, play, steady
play(Recorder(Counting(), id="{ID}", path=sys.argv[1]), 7, steady)
sys.exit(3)
"""
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = python("-c", code, tmp_path / "ds", cwd=ROOT, env=variables, check=False)
    assert ended.returncode == 3
    assert len(recover(tmp_path / "ds")) == 7


def test_a_damaged_part_is_named(tmp_path: Path) -> None:
    """Row 09: of a recording that is not finished."""
    path = interrupted(tmp_path / "ds", 12)
    (part,) = unfinished_folder(path).glob("part-*")
    assert len(read_part_table(part)) == 12
    with (part / "rewards.npy").open("r+b") as file:
        file.truncate(100)
    with pytest.raises(DatasetError, match=r"rewards.npy .* Move the part .* away"):
        recover(path)
    assert unfinished_folder(path).exists(), "the rest is kept"
