"""Parquet: pyarrow and Hugging Face's `datasets` read what we write."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.export import export_dataset
from swarmdata.types import END_REASONS

pyarrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")

RoundTrip = Callable[[Dataset, str], Dataset]
TakeIn = Callable[..., Any]  # gives `Taken` of conftest.py


@pytest.mark.slow
def test_blocks_do_not_matter(
    ours: Dataset, round_trip: RoundTrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmdata.interop.conversion.dataset_facts.BLOCK_BYTES", 2000)
    monkeypatch.setattr("swarmdata.interop.conversion.foreign_data.BLOCK_BYTES", 1500)
    monkeypatch.setattr("swarmdata.interop.convert.BLOCK_BYTES", 1000)
    monkeypatch.setattr("swarmdata.interop.parquet._GROUP_ROWS", 3)
    round_trip(ours, "parquet")


def test_columns_are_aligned(recorded: Dataset, tmp_path: Path) -> None:
    path = export_dataset(recorded, tmp_path / "x", format="parquet")
    train = recorded.split("train")
    table = parquet.read_table(path / "data/train-00000-of-00001.parquet")
    expected = train.transitions()
    for name in ("observations", "next_observations", "actions", "rewards", "terminations"):
        np.testing.assert_array_equal(np.array(table[name].to_pylist()), expected[name])
    lengths = train.episodes.lengths
    assert table["episode"].to_pylist() == np.repeat(train.selection, lengths).tolist()
    assert table["step"].to_pylist() == [t for n in lengths for t in range(n)]
    assert parquet.read_table(path / "episodes.parquet").num_rows == len(recorded)


@pytest.mark.slow
def test_hugging_face_datasets_reads_it(
    recorded: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets", reason="the dependency group 'interop'")
    path = export_dataset(recorded, tmp_path / "x", format="parquet")
    found = datasets.load_dataset(str(path), cache_dir=str(tmp_path / "cache"))
    assert set(found) == {"train", "validation", "test"}
    for split in found:
        view = recorded.split(split)
        arrays = found[split].with_format("numpy")[:]
        for name in ("observations", "actions", "next_observations"):
            np.testing.assert_array_equal(arrays[name], view.transitions()[name])
    episodes = datasets.load_dataset(str(path), "episodes", cache_dir=str(tmp_path / "cache"))
    assert episodes["episodes"]["length"][:] == recorded.episodes.lengths.tolist()


def write_theirs(path: Path, lengths: list[int], cut: list[bool], **changes: Any) -> Path:
    episode = np.repeat(np.arange(len(lengths)), lengths)
    time = np.concatenate([np.arange(n) for n in lengths])
    last = np.concatenate([np.arange(n) == n - 1 for n in lengths])
    is_cut = np.repeat(cut, lengths)
    columns = {
        "observations": np.stack([episode, time], 1).tolist(),
        "next_observations": np.stack([episode, time + 1], 1).tolist(),
        "actions": (time % 3).tolist(),
        "rewards": (100.0 * episode + time).tolist(),
        "terminations": (last & ~is_cut).tolist(),
        "truncations": (last & is_cut).tolist(),
        **changes,
    }
    table = pyarrow.table({k: v for k, v in columns.items() if v is not None})
    parquet.write_table(table, path, row_group_size=10)
    return path


def test_a_file_of_others(tmp_path: Path, take_in: TakeIn) -> None:
    lengths, cut = [3, 5, 1, 4] * 7, [False, True] * 14
    path = write_theirs(tmp_path / "x.parquet", lengths, cut)
    dataset = take_in(path, "parquet")
    assert dataset.lengths == lengths
    assert dataset.spec.agents[0].action.n == 3
    for number, episode in enumerate(dataset.episodes):
        t = np.arange(len(episode))
        assert (episode.observations[:, 0, 0] == number).all()
        np.testing.assert_array_equal(episode.observations[:, 0, 1], np.arange(len(t) + 1))
        np.testing.assert_array_equal(episode.actions[:, 0, 0], t % 3)
        np.testing.assert_array_equal(episode.rewards[:, 0], 100 * number + t)
        assert END_REASONS[episode.end_reason] == ("horizon" if cut[number] else "ended")


def test_what_cannot_be_read(ours: Dataset, tmp_path: Path, take_in: TakeIn) -> None:
    lengths, cut = [3, 5] * 14, [False, True] * 14
    path = write_theirs(tmp_path / "a.parquet", lengths, cut, rewards=None)
    with pytest.raises(ConversionError, match=r"no columns \['rewards'\]"):
        take_in(path, "parquet")
    ragged = [[1.0]] * (sum(lengths) - 1) + [[1.0, 2.0]]
    path = write_theirs(tmp_path / "b.parquet", lengths, cut, observations=ragged)
    with pytest.raises(ConversionError, match="rows of different lengths"):
        take_in(path, "parquet")
    with pytest.raises(ConversionError, match=r"sizes \{'observations': 2"):
        take_in(write_theirs(tmp_path / "c.parquet", lengths, cut), "parquet", n_agents=3)
    (tmp_path / "d.parquet").write_text("no")
    with pytest.raises(ConversionError, match="not a Parquet file"):
        take_in(tmp_path / "d.parquet", "parquet")
    with pytest.raises(ConversionError, match=r"no swarmdata\.json of an export, but 4 Parq"):
        take_in(tmp_path, "parquet")
    exported = export_dataset(ours, tmp_path / "x", format="parquet")
    theirs = write_theirs(tmp_path / "e.parquet", lengths, cut)
    theirs.replace(exported / "data/train-00000-of-00001.parquet")
    with pytest.raises(ConversionError, match="its note of swarmdata says"):
        take_in(exported, "parquet")
