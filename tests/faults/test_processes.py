"""Kills at any moment and many processes at once: nothing lost, nothing half-visible, one build."""

import gc
import json
import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.specs.task_spec import TaskSpec
from tests.faults.kill_points import survive
from tests.faults.load_one import load_tiny
from tests.support.at_once import Forked
from tests.support.command_line import run
from tests.support.pairs import slow


def kill_points(operation: str, folder: Path, stride: int) -> dict[str, int]:
    code, out, err = Forked(operation, folder, str(stride), work=survive).end()
    assert code == 0, err
    found: dict[str, int] = json.loads(out.splitlines()[-1])
    return found


def test_a_kill_before_any_change_of_the_disk_is_survived(tmp_path: Path) -> None:
    """Row 02: a few of the moments of publishing; the slow test takes more, and of more."""
    found = kill_points("publish", tmp_path, 50)
    assert found["kills"] >= 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("operation", "stride", "least"),
    [("publish", 5, 30), ("repair", 1, 30), ("fetch", 4, 30), ("export", 3, 2)],
)
def test_kills_before_many_changes_of_the_disk_are_survived(
    tmp_path: Path, operation: str, stride: int, least: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows 02, 58: what is visible is whole, and running again gives every byte."""
    found = kill_points(operation, tmp_path, stride)
    with capsys.disabled():
        print(f"\n{operation}: {found['kills']} kills survived, {found['changes']} changes")
    assert found["kills"] >= least


def test_a_killed_holder_of_the_lock_is_taken_over(tmp_path: Path, cache_folder: Path) -> None:
    """Rows 05, 26: who waits says for whom, and goes on at once when that one is killed."""
    notes = tmp_path / "builds"
    holder = Forked(notes, "hold", work=load_tiny)
    holder.wait_for(lambda out, err: notes.exists())
    second = Forked(notes, work=load_tiny)
    second.wait_for(lambda out, err: f"in use by process {holder.pid} on" in err)
    holder.send(signal.SIGKILL)
    holder.end()
    code, out, err = second.end()

    assert code == 0, err
    assert out.split()[1] == "rebuilt"
    assert len(notes.read_text().split()) == 2, "the killed one had begun as well"
    assert not list(cache_folder.rglob("*.lock"))


@pytest.mark.slow
@pytest.mark.parametrize("n_processes", [2, 8])
def test_processes_that_load_one_uncached_id_make_one_build(
    tmp_path: Path, n_processes: int
) -> None:
    """Rows 05, 26: one builds, the others wait; all have the same digest."""
    notes = tmp_path / "builds"
    results = [each.end() for each in [Forked(notes, work=load_tiny) for _ in range(n_processes)]]
    assert [code for code, _, _ in results] == [0] * n_processes, results
    lines = [out.split() for _, out, _ in results]
    assert len({digest for digest, _ in lines}) == 1
    assert sorted(source for _, source in lines) == ["cache"] * (n_processes - 1) + ["rebuilt"]
    assert len(notes.read_text().split()) == 1


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> Dataset:
    out = tmp_path_factory.mktemp("shared") / "d"
    return Dataset.open(record(out, TaskSpec(horizon=20), ("random", "straight")))


def _sum(dataset: Dataset, index: int) -> float:
    return float(dataset[index].states.sum(dtype=np.float64))


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208 (a count, no paths)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_loader_workers_see_the_same_data_and_leak_nothing(dataset: Dataset, method: str) -> None:
    """Row 33: two epochs in worker processes, no deadlock, no open files left."""
    data = pytest.importorskip("torch.utils.data", reason="DataLoader is torch's")
    before = open_files()
    for _ in range(2):
        loader = data.DataLoader(
            dataset, batch_size=None, num_workers=2,
            multiprocessing_context=multiprocessing.get_context(method),
        )  # fmt: skip
        sums = [float(episode.states.sum(dtype=np.float64)) for episode in loader]
        assert sums == [_sum(dataset, index) for index in range(len(dataset))]
        del loader
    end = time.monotonic() + 60  # queues of workers that have ended close in threads
    while open_files() > before + 2 and time.monotonic() < end:
        gc.collect()
        time.sleep(0.05)
    assert open_files() <= before + 2


def put_ten_entries(file: str, letter: str) -> None:
    from swarmdata.hub.publishing.regenerate import put_entries

    for k in range(10):
        put_entries(Path(file), {f"{letter}-{k}": {"digest": "x" * 200}})


def add_ten_remotes(_: str, letter: str) -> None:
    for k in range(10):
        run("remote", "add", f"hf://org{letter}-{k}")


@pytest.mark.parametrize("what", slow("registry", "remotes"))
def test_no_update_of_two_processes_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """Row 62: `registry update` kept 26 of 40, `remote add` 12 of 40."""
    file = tmp_path / "published.json"
    work = {"registry": put_ten_entries, "remotes": add_ten_remotes}[what]
    monkeypatch.delenv("SWARMDATA_REMOTES")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    results = [each.end() for each in [Forked(file, letter, work=work) for letter in "ab"]]
    assert [code for code, _, _ in results] == [0, 0], results
    if what == "registry":
        assert len(json.loads(file.read_text())) == 20
    else:
        (file,) = tmp_path.rglob("remotes.yaml")
        assert file.read_text().count("- hf://org") == 20
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def train_bc(folder: str) -> None:
    from tests.learn.training.test_trainer import run

    run("bc", Path(folder), progress=True)


@pytest.mark.slow
def test_two_trainings_in_one_folder(tmp_path: Path) -> None:
    """Row 63: one trains, the other waits and finds it done; the losses are those of one run."""
    pytest.importorskip("torch", reason="training needs torch")
    from tests.learn.training.test_trainer import run

    results = [each.end() for each in [Forked(tmp_path / "d", work=train_bc) for _ in range(2)]]
    assert [code for code, _, _ in results] == [0, 0], results
    run("bc", tmp_path / "alone")
    for name in ("losses.csv", "curve.csv", "checkpoint.safetensors"):
        assert (tmp_path / "d" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert not list((tmp_path / "d").glob(".*"))
