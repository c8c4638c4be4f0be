import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
import zarr

from swarmdata.specs.task_spec import Obstacles
from swarmdata.store import open_store
from swarmdata.store.arrays import layout as layout_module
from swarmdata.store.arrays.layout import array_file, plan_shard
from swarmdata.store.arrays.running_moments import RunningMoments
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.assembly import assemble
from swarmdata.store.damage import logical_digest
from swarmdata.store.episode_order import merge_order
from swarmdata.store.manifest import FileEntry
from swarmdata.testing.synthetic import (
    SPEC,
    make_dataset,
    make_episode,
    make_recipe,
    make_streams,
    write_streams,
)
from tests.support.made_episodes import stored

LENGTHS = [[3, 1, 7, 4, 2, 9, 1, 6], [5, 5, 1, 8, 1, 1, 3, 2]]


def test_zarr_itself_writes_our_bytes(tmp_path: Path) -> None:
    manifest, _ = make_dataset(tmp_path / "ds", LENGTHS, n_steps=30)
    compared = set()
    for name, entry in manifest.arrays.items():
        file = tmp_path / "ds" / array_file(name, len(entry.shape))
        ours = file.read_bytes()
        array = zarr.open_array(
            tmp_path / "ds" / "data.zarr" / name, mode="r+", config={"write_empty_chunks": True}
        )
        values = np.asarray(array[...])
        if not values.any():  # zarr-python writes no file for a shard of fill values only
            continue
        file.unlink()
        array[...] = values
        assert file.read_bytes() == ours, name
        compared.add(name)
    assert compared >= {"observations", "actions", "events", "episodes/layouts", "episodes/seeds"}


def test_digest_ignores_parts_and_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = make_dataset(tmp_path / "a", LENGTHS, n_steps=30)
    monkeypatch.setattr(layout_module, "CHUNK_ROWS", 3)
    recipe = make_recipe(30, n_policies=2)
    parts = write_streams(tmp_path / "parts", make_streams(LENGTHS), per_part=5)
    order = merge_order(recipe, LENGTHS).order
    second = assemble(tmp_path / "b", recipe=recipe, parts=parts, order=order)
    assert second.digest == first.digest
    assert second.statistics == first.statistics
    assert second.arrays["actions"].checksums != first.arrays["actions"].checksums


def test_transport_digest_is_that_of_the_files(tmp_path: Path) -> None:
    manifest, _ = make_dataset(tmp_path / "ds", LENGTHS, n_steps=30)
    files = [p for p in (tmp_path / "ds").rglob("*") if p.is_file() and p.name != "manifest.json"]
    names = sorted(path.relative_to(tmp_path / "ds").as_posix() for path in files)
    lines = [f"{file_digest(tmp_path / 'ds' / name)}  {name}\n" for name in names]
    expected = hashlib.sha256("".join(lines).encode()).hexdigest()
    assert manifest.transport_digest == expected

    first = names[0]
    other = FileEntry(size=manifest.files[first].size, sha256="0" * 64)
    changed = manifest.model_copy(update={"files": {**manifest.files, first: other}})
    assert changed.transport_digest != expected
    assert changed.digest == manifest.digest


def test_digest_depends_on_every_value(tmp_path: Path) -> None:
    make_dataset(tmp_path / "ds", LENGTHS, n_steps=30)
    stored = open_store(tmp_path / "ds")
    for name, array in stored.arrays.items():
        changed = {n: a.copy().reshape(-1).view(np.uint8) for n, a in stored.arrays.items()}
        assert logical_digest(stored.manifest, changed) == stored.manifest.digest
        changed[name][array.nbytes // 2] ^= 1
        assert logical_digest(stored.manifest, changed) != stored.manifest.digest


def test_layouts_without_obstacles(tmp_path: Path) -> None:
    episodes = [make_episode(3, seed=i, n_obstacles=0) for i in range(5)]
    spec = SPEC.with_updates(obstacles=Obstacles(circles=0, boxes=0, corners=0, pockets=0))
    stored(tmp_path / "ds", make_recipe(15, spec=spec), [episodes])
    assert open_store(tmp_path / "ds", "full").table.layouts.shape == (5, 0, 8)
    group = zarr.open_group(tmp_path / "ds" / "data.zarr", mode="r")
    layouts = group["episodes/layouts"]
    assert isinstance(layouts, zarr.Array)
    assert layouts.shape == (5, 0, 8)


@pytest.mark.parametrize("rows", [1, 9_999, 10_000, 10_001, 1_000_000, 1_008_000])
def test_shards_waste_little(rows: int) -> None:
    shard = plan_shard("float32", (rows, 4, 53))
    assert shard.chunk_rows <= 10_000
    assert shard.n_chunks * shard.chunk_rows - rows < shard.n_chunks
    assert shard.n_chunks == math.ceil(rows / 10_000)


def test_moments_agree_with_numpy_in_any_blocks() -> None:
    rows = np.random.default_rng(0).normal(1000, 0.1, size=(500, 3)).astype(np.float32)
    rows[:, 2] = 0.3
    moments = RunningMoments()
    for block in np.split(rows, [10, 11, 200]):
        moments.add(block)
    mean, std = moments.result()
    np.testing.assert_allclose(mean, rows.mean(0, dtype=np.float64), rtol=1e-12)
    np.testing.assert_allclose(std[:2], rows.std(0, dtype=np.float64)[:2], rtol=1e-9)
    assert std[2] == 0.0
