"""Arrays in several files are the same arrays: for us, for Zarr, and in every digest."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import (
    ChecksumError,
    DatasetError,
    ManifestError,
    MissingFileError,
    TruncatedFileError,
)
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.pull_dataset import fetch_file, pull
from swarmdata.store import open_store, read_manifest
from swarmdata.store.arrays import layout
from swarmdata.store.arrays.layout import array_file, is_array_file, plan_shard
from swarmdata.store.damage import find_damage
from swarmdata.testing.dataset_contract import check_dataset
from swarmdata.testing.synthetic import make_dataset, write_release
from tests.support.tiny import flip, sign

LENGTHS = [[600, 300, 90, 410, 700, 300, 500, 100] * 3]
"""9,000 joint steps."""

PAGES = 4096


@pytest.fixture
def small_shards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of a few pages, and chunks of 256 rows."""
    monkeypatch.setattr(layout, "SHARD_BYTES", 200_000)
    monkeypatch.setattr(layout, "PAGE_BYTES", PAGES)
    monkeypatch.setattr(layout, "CHUNK_ROWS", 300)


@pytest.fixture
def sharded(tmp_path: Path, small_shards: None) -> Path:
    """A dataset whose observations are in six files or so."""
    make_dataset(tmp_path / "ds", LENGTHS)
    return tmp_path / "ds"


def test_the_arrays_are_those_of_one_file_each(sharded: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "SHARD_BYTES", 1 << 40)
        make_dataset(tmp_path / "whole", LENGTHS)
    whole, found = open_store(tmp_path / "whole"), open_store(sharded, "full")
    assert found.manifest.digest == whole.manifest.digest
    assert found.manifest.statistics == whole.manifest.statistics
    assert (whole.manifest.format_version, found.manifest.format_version) == (1, 2)
    assert "shard_rows" not in (tmp_path / "whole" / "manifest.json").read_text()
    shards = {name: plan.shard for name, plan in found.manifest.plan.items()}
    assert shards["observations"].n_shards > 3
    assert shards["terminations"].n_shards == 1
    assert shards["observations"].shard_rows == shards["observations"].shard_chunks * 256
    for name, array in whole.arrays.items():
        assert array.tobytes() == found.arrays[name].tobytes(), name
        assert not found.arrays[name].flags.writeable
    check_dataset(sharded)


def test_zarr_reads_the_same_bits(sharded: Path) -> None:
    stored = open_store(sharded)
    group = zarr.open_group(sharded / "data.zarr", mode="r")
    for name, values in stored.arrays.items():
        array = group[name]
        assert isinstance(array, zarr.Array)
        assert np.asarray(array[...]).tobytes() == values.tobytes(), name


def test_zarr_itself_writes_our_bytes(sharded: Path) -> None:
    """But for the last file, where it pads with chunks after the end of the array."""
    files = read_manifest(sharded).plan["observations"].files
    ours = [(sharded / file).read_bytes() for file in files]
    path = sharded / "data.zarr" / "observations"
    array = zarr.open_array(path, mode="r+", config={"write_empty_chunks": True})
    values = np.asarray(array[...])
    for file in files:
        (sharded / file).unlink()
    array[...] = values
    assert [(sharded / file).read_bytes() for file in files[:-1]] == ours[:-1]


@given(
    rows=st.integers(1, 30_000),
    inner=st.lists(st.integers(1, 90), max_size=2),
    dtype=st.sampled_from(["bool", "float32", "float64"]),
    limit=st.integers(1, 1 << 22),
)
def test_plans_are_whole_pages_and_bounded(
    rows: int, inner: list[int], dtype: layout.DType, limit: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "SHARD_BYTES", limit)
        shard = plan_shard(dtype, (rows, *inner))
    row_bytes = shard.nbytes // rows
    assert shard.chunk_rows <= layout.CHUNK_ROWS
    assert shard.n_shards == -(-rows // (shard.shard_rows or rows))
    assert [k for n in range(shard.n_shards) for k in shard.chunks_of(n)] == [
        *range(shard.n_chunks)
    ]
    assert sum(shard.data_of(n) for n in range(shard.n_shards)) == shard.data_bytes
    if shard.shard_rows is None:
        assert shard.nbytes <= limit
        return
    assert shard.shard_rows % shard.chunk_rows == 0
    assert shard.shard_rows * row_bytes % layout.PAGE_BYTES == 0
    smallest = max(shard.chunk_rows * row_bytes, np.lcm(row_bytes, layout.PAGE_BYTES))
    assert shard.shard_rows * row_bytes <= max(limit, smallest)


@pytest.mark.parametrize("shard", [1, 2])
def test_a_flipped_bit_is_found_in_its_file(sharded: Path, shard: int) -> None:
    plan = read_manifest(sharded).plan["observations"]
    chunk = plan.shard.chunks_of(shard)[1]
    flip(sharded / plan.files[shard], plan.shard.chunk_bytes + 7)
    with pytest.raises(ChecksumError, match=f"{plan.files[shard]} .*chunk {chunk} of"):
        open_store(sharded)
    (damage,) = find_damage(sharded)
    assert (damage.file, damage.chunk) == (plan.files[shard], chunk)
    assert damage.rows == (256 * chunk, 256 * chunk + 255)


def test_every_file_is_needed_whole(sharded: Path) -> None:
    file = sharded / read_manifest(sharded).plan["observations"].files[1]
    content = file.read_bytes()
    file.write_bytes(content[:-1])
    with pytest.raises(TruncatedFileError):
        open_store(sharded)
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(ChecksumError, match="shard index"):
        open_store(sharded)
    file.unlink()
    with pytest.raises(MissingFileError):
        open_store(sharded)


def test_a_link_in_the_place_of_a_later_file_is_refused(sharded: Path) -> None:
    file = sharded / read_manifest(sharded).plan["observations"].files[2]
    file.rename(sharded.parent / "elsewhere")
    file.symlink_to(sharded.parent / "elsewhere")
    with pytest.raises(ManifestError, match="symbolic link"):
        open_store(sharded)


@pytest.mark.usefixtures("small_shards")
def test_files_travel_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout, "SHARD_BYTES", 20_000)
    name = "coop_nav-large-v0"
    source = write_release(tmp_path / "source", LENGTHS[0], name)
    (tmp_path / "remote").mkdir()
    remote = FolderRemote((tmp_path / "remote").as_uri())
    remote.publish(source, name)
    release = remote.find(name)
    assert release is not None
    copy = pull(remote, release, tmp_path / "copy", progress=False)
    assert open_store(copy, "full").manifest == read_manifest(source)
    file = read_manifest(copy).plan["observations"].files[1]
    flip(copy / file, 100)
    (damage,) = find_damage(copy)
    assert damage.file == file
    fetch_file(remote, release, read_manifest(copy), file, copy / file)
    assert (copy / file).read_bytes() == (source / file).read_bytes()


def test_a_hostile_layout_is_refused(sharded: Path) -> None:
    content = json.loads((sharded / "manifest.json").read_bytes())
    entry = content["arrays"]["observations"]
    for rows in (entry["shard_rows"] + 1, 1, 256 * 10**15):
        entry["shard_rows"] = rows
        other = sharded.parent / f"other-{rows}"
        shutil.copytree(sharded, other)
        sign(other, content)
        with pytest.raises(DatasetError):
            open_store(other)


def test_names_of_files_are_told_from_others() -> None:
    assert is_array_file(array_file("observations", 3, 17))
    assert is_array_file("data.zarr/episodes/seeds/c.2")
    for name in ("data.zarr/observations/c.1.0", "data.zarr/seen/c.0", "observations/c.0.0.0",
                 "data.zarr/observations/c.01.0.0", "data.zarr/observations/c.x.0.0"):  # fmt: skip
        assert not is_array_file(name), name


def test_zarr_itself_writes_our_metadata(sharded: Path, tmp_path: Path) -> None:
    ours = zarr.open_group(sharded / "data.zarr", mode="r")
    theirs = zarr.create_group(tmp_path / "theirs", attributes=dict(ours.attrs))
    for name, plan in read_manifest(sharded).plan.items():
        array = ours[name]
        assert isinstance(array, zarr.Array)
        written = theirs.create_array(
            name,
            shape=plan.shard.shape,
            chunks=array.chunks,
            shards=array.shards,
            dtype=plan.shard.dtype,
            compressors=None,
            filters=None,
            fill_value=0,
            chunk_key_encoding={"name": "default", "separator": "."},
            dimension_names=layout.ALL_FIELDS[name].dimensions,
            attributes=dict(array.attrs),
        )
        assert array.metadata == written.metadata
    assert ours.metadata == theirs.metadata
    assert dict(ours["episodes"].attrs) == {}
