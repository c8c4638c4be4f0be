"""LeRobot datasets: the documented layout, read by pyarrow, pandas and TorchRL's own reader."""

import json
import tracemalloc
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.export import export_dataset
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS
from tests.interop.conftest import recorded_episodes, write_recording
from tests.support.tiny import make_tiny

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")


def frames_of(path: Path) -> dict[str, np.ndarray]:
    """All columns, [frames, ...], in the order of the files."""
    tables = [parquet.read_table(file) for file in sorted(path.glob("data/*/*.parquet"))]
    return {
        name: np.concatenate([np.array(table[name].to_pylist()) for table in tables])
        for name in tables[0].column_names
    }


def ordered(dataset: Dataset) -> Dataset:
    order = np.argsort(dataset.episodes.split, kind="stable")
    return replace(dataset, selection=dataset.selection[order])


def check_frames(columns: Mapping[str, np.ndarray], dataset: Dataset) -> None:
    first = 0
    for k, episode in enumerate(dataset):
        rows = slice(first, first + len(episode))
        for name, expected in {
            "observation.state": episode.observations[:-1].reshape(len(episode), -1),
            "action": episode.actions.reshape(len(episode), -1),
            "observation.environment_state": episode.states[:-1],
            "agent_rewards": episode.rewards,
            "next.done": episode.terminations,
            "episode_index": np.full(len(episode), k),
            "frame_index": np.arange(len(episode)),
        }.items():
            np.testing.assert_array_equal(columns[name][rows], expected, err_msg=name)
        np.testing.assert_allclose(
            columns["next.reward"][rows], episode.rewards.mean(1), rtol=1e-6, atol=1e-7
        )
        first += len(episode)
    np.testing.assert_array_equal(columns["index"], np.arange(first))


@pytest.fixture(scope="module")
def dataset(tiny: Path) -> Dataset:
    return Dataset.open(tiny)


@pytest.mark.parametrize("file_bytes", [100 << 20, 1 << 17])
def test_layout(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file_bytes: int
) -> None:
    monkeypatch.setattr("swarmdata.interop.lerobot.FILE_BYTES", file_bytes)
    monkeypatch.setattr("swarmdata.interop.lerobot.CHUNK_FILES", 2)
    path, expected = export_dataset(dataset, tmp_path / "out", format="lerobot"), ordered(dataset)
    columns = frames_of(path)
    check_frames(columns, expected)
    np.testing.assert_allclose(columns["timestamp"], columns["frame_index"] / 10, rtol=1e-6)
    info = json.loads((path / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 10)
    assert (info["total_episodes"], info["total_frames"]) == (len(dataset), len(columns["index"]))
    for name, ends in info["splits"].items():
        first, last = map(int, ends.split(":"))
        assert set(expected.episodes.split[first:last]) == {SPLITS.index(name)}
    feature = info["features"]["observation.state"]
    assert feature["shape"] == [len(feature["names"])] == [columns["observation.state"].shape[1]]
    assert feature["names"][0].startswith("robot_0.own.")
    rows = parquet.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for row, length in zip(rows, expected.episodes.lengths, strict=True):
        assert row["length"] == length == row["dataset_to_index"] - row["dataset_from_index"]
        place = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
        inside = parquet.read_table(path / info["data_path"].format(**place))["episode_index"]
        assert row["episode_index"] in inside.to_pylist()
    n_files = len(list(path.glob("data/*/*.parquet")))
    assert (n_files == 1) == (file_bytes > 1 << 20)


def test_statistics_are_those_of_all_frames(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmdata.interop.lerobot.GROUP_EPISODES", 3)
    path = export_dataset(dataset, tmp_path / "out", format="lerobot")
    found, columns = json.loads((path / "meta/stats.json").read_text()), frames_of(path)
    assert set(found) == set(columns)
    for name, values in columns.items():
        rows = values.reshape(len(values), -1).astype(np.float64)
        assert found[name]["count"] == [len(rows)]
        for key, expected in (
            ("min", rows.min(0)), ("max", rows.max(0)), ("mean", rows.mean(0)), ("std", rows.std(0))
        ):  # fmt: skip
            np.testing.assert_allclose(found[name][key], expected, rtol=1e-9, atol=1e-9)


def test_memory_does_not_grow_with_the_episodes(tmp_path: Path) -> None:
    peaks = []
    for n in (100, 200, 400):  # the first one imports and compiles
        (tmp_path / str(n)).mkdir()
        dataset = write_recording(tmp_path / str(n), recorded_episodes([3] * n))
        tracemalloc.start()
        export_dataset(dataset, tmp_path / f"out-{n}", format="lerobot")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.5 * peaks[1]


def test_pandas_finds_the_task_by_its_name(dataset: Dataset, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="reads as LeRobot does")
    path = export_dataset(dataset, tmp_path / "out", format="lerobot")
    assert pandas.read_parquet(path / "meta/tasks.parquet").loc["coop_nav"].task_index == 0


def test_recordings_have_no_names(recorded: Dataset, tmp_path: Path) -> None:
    path = export_dataset(recorded, tmp_path / "out", format="lerobot")
    features = json.loads((path / "meta/info.json").read_text())["features"]
    assert features["action"]["names"] == ["adversary_0.0", "agent_0.0", "agent_0.1"]
    assert frames_of(path)["action"].shape[1] == 3


def test_times_are_whole_frames(tmp_path: Path) -> None:
    spec = TaskSpec(horizon=40, control_dt=0.3, physics_dt=0.05)
    dataset = Dataset.open(make_tiny(tmp_path / "tiny", spec=spec))
    with pytest.raises(ConversionError, match=r"3\.33333 steps a second"):
        export_dataset(dataset, tmp_path / "out", format="lerobot")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_torchrl_reads_it(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    datasets = pytest.importorskip("torchrl.data.datasets", reason="the group 'interop'")
    if not hasattr(datasets, "LeRobotExperienceReplay"):
        pytest.skip("this torchrl reads no LeRobot datasets")
    path = export_dataset(dataset, tmp_path / "out", format="lerobot")
    monkeypatch.setattr("huggingface_hub.snapshot_download", lambda *_, **__: str(path))
    monkeypatch.setenv("HF_DATASETS_CACHE", str(tmp_path / "cache"))
    replay: Any = datasets.LeRobotExperienceReplay("a/b", root=tmp_path / "root", batch_size=8)
    data = replay[:]
    columns = {
        "observation.state": data["observation", "state"],
        "observation.environment_state": data["observation", "environment_state"],
        "action": data["action"],
        "agent_rewards": data["agent_rewards"],
        "next.reward": data["next", "reward"][..., 0],
        "next.done": data["next", "done"][..., 0],
        "episode_index": data["episode"],
        "frame_index": data["frame"],
        "index": data["index"],
    }
    check_frames({name: np.asarray(values) for name, values in columns.items()}, ordered(dataset))
    assert set(data["language_instruction"]) == {"coop_nav"}
