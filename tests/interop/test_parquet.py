"""Parquet: pyarrow and Hugging Face's `datasets` read what we write."""

from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.export import export_dataset
from tests.interop.foreign import TakeIn, timeline
from tests.interop.foreign import parquet as write

pyarrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")


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


def test_what_cannot_be_read(ours: Dataset, tmp_path: Path, take_in: TakeIn) -> None:
    arrays = timeline([3, 5] * 14, [False, True] * 14)
    rest = {name: values for name, values in arrays.items() if name != "rewards"}
    ragged = np.array([[1.0]] * (8 * 14 - 1) + [[1.0, 2.0]], dtype=object)
    for name, given, words in (
        ("a", rest, r"no columns \['rewards'\]"),
        ("b", {**arrays, "observations": ragged}, "rows of different lengths"),
    ):
        with pytest.raises(ConversionError, match=words):
            take_in(write(tmp_path / f"{name}.parquet", given), "parquet")
    with pytest.raises(ConversionError, match=r"sizes \{'observations': 2"):
        take_in(write(tmp_path / "c.parquet", arrays), "parquet", n_agents=3)
    (tmp_path / "d.parquet").write_text("no")
    with pytest.raises(ConversionError, match="not a Parquet file"):
        take_in(tmp_path / "d.parquet", "parquet")
    with pytest.raises(ConversionError, match=r"no swarmdata\.json of an export, but 4 Parq"):
        take_in(tmp_path, "parquet")
    exported = export_dataset(ours, tmp_path / "x", format="parquet")
    theirs = write(tmp_path / "e.parquet", arrays)
    theirs.replace(exported / "data/train-00000-of-00001.parquet")
    with pytest.raises(ConversionError, match="its note of swarmdata says"):
        take_in(exported, "parquet")
