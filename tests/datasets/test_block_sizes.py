"""Results of block-wise work do not depend on the sizes of blocks, nor on where arrays are kept."""

import gc
import pickle
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmdata.audit import content_checks, subject
from swarmdata.audit.checks import audit
from swarmdata.audit.findings import Finding
from swarmdata.building.edit import subsample_dataset
from swarmdata.cards.sections.measured_content import card_data_of
from swarmdata.datasets import reobservation, reweighting
from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.convert import source_digest
from swarmdata.interop.export import export_dataset, in_frame
from swarmdata.runtime import mapped_pages
from swarmdata.runtime.mapped_pages import MappedReads, mapping_of
from swarmdata.store import damage
from swarmdata.store.arrays import scratch_arrays
from swarmdata.store.arrays.scratch_arrays import ScratchMap, new_arrays
from swarmdata.store.damage import logical_digest
from swarmdata.store.stored_dataset import map_checked


@pytest.fixture
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages are given back after each read, and computed arrays are in files."""
    monkeypatch.setattr(mapped_pages, "READ_BYTES", 1)
    monkeypatch.setattr(mapped_pages, "REGION_BYTES", 64)
    monkeypatch.setattr(damage, "BLOCK_BYTES", 1000)
    monkeypatch.setattr(scratch_arrays, "MEMORY_BYTES", 0)


@pytest.mark.slow
@settings(max_examples=5)
@given(rows=st.integers(1, 300), ends=st.integers(1, 20))
def test_an_audit_does_not_depend_on_its_blocks(tiny: Path, rows: int, ends: int) -> None:
    whole = findings_without_replay(tiny)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subject, "BLOCK_ROWS", rows)
        patch.setattr(content_checks, "BLOCK_ROWS", rows)
        patch.setattr(content_checks, "END_EPISODES", ends)
        assert findings_without_replay(tiny) == whole


def findings_without_replay(path: Path) -> tuple[Finding, ...]:
    return audit(path, sample=0, progress=False).findings


def test_shares_of_distinct_rows_are_estimated_from_some(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = subject.Subject.of(Dataset.open(tiny).stored, 0, progress=False)
    data.arrays["states"] = np.repeat(data.arrays["states"][::4], 4, axis=0)[
        : len(data.arrays["states"])
    ]
    every = np.ones(len(data.table), dtype=np.bool_)
    exact = content_checks._distinct_share(data, "states", every)
    monkeypatch.setattr(content_checks, "MOST_KEYS", len(data.arrays["states"]) // 2)
    estimated = content_checks._distinct_share(data, "states", every)
    assert estimated != exact  # of other rows
    assert estimated == pytest.approx(exact, rel=0.1)
    assert exact == pytest.approx(0.25, rel=0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("tight")
def test_a_copy_does_not_depend_on_reads(tiny: Path, tmp_path: Path) -> None:
    data = Dataset.open(tiny)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapped_pages, "READ_BYTES", 1 << 40)
        wanted = subsample_dataset(data, tmp_path / "a", id="coop_nav-some-v0", n_steps=150).digest
        export_dataset(data, tmp_path / "a.hdf5", format="d4rl")
        copied, measured = data.transitions(), card_data_of(data.stored)
    found = subsample_dataset(data, tmp_path / "b", id="coop_nav-some-v0", n_steps=150)
    assert found.digest == wanted
    export_dataset(data, tmp_path / "b.hdf5", format="d4rl")
    assert source_digest(tmp_path / "b.hdf5") == source_digest(tmp_path / "a.hdf5")
    for name, values in data.transitions().items():
        assert values.tobytes() == copied[name].tobytes(), name
    again = card_data_of(data.stored)
    assert again.log_probs == measured.log_probs
    assert repr(again.coverage) == repr(measured.coverage)
    raw = {name: map_checked(tiny, data.stored.manifest, name) for name in data.stored.arrays}
    assert logical_digest(data.stored.manifest, raw) == data.digest


@pytest.mark.usefixtures("tight")
def test_other_rewards_do_not_depend_on_blocks(tiny: Path) -> None:
    data = Dataset.open(tiny)
    whole = data.with_rewards(robot_collision=2.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reweighting, "BLOCK_ROWS", 7)
        again = data.with_rewards(robot_collision=2.0)
    assert isinstance(mapping_of(again.stored.arrays["rewards"]), ScratchMap)
    for name in ("rewards", "episodes/team_return"):
        values = again.stored.arrays[name]
        assert not values.flags.writeable
        assert values.tobytes() == whole.stored.arrays[name].tobytes(), name


def test_a_frame_does_not_depend_on_where_arrays_are(tiny: Path) -> None:
    data = Dataset.open(tiny).split("train")
    whole = in_frame(data, "target").stored
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapped_pages, "READ_BYTES", 1)
        patch.setattr(scratch_arrays, "MEMORY_BYTES", 0)
        again = in_frame(data, "target").stored
    for name in ("observations", "actions"):
        assert isinstance(mapping_of(again.arrays[name]), ScratchMap)
        assert again.arrays[name].tobytes() == whole.arrays[name].tobytes(), name
    starts = data.stored.table.starts
    others = np.setdiff1d(np.arange(len(starts)), data.selection)
    assert not again.arrays["actions"][starts[others]].any()


@pytest.mark.slow
@given(states=st.integers(1, 200))
def test_observing_again_does_not_depend_on_blocks(tiny: Path, states: int) -> None:
    data = Dataset.open(tiny)
    models = "lidar-8+noise-0.05", "lossy-30+range-1.5"
    whole = data.reobserve(*models, progress=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reobservation, "OBSERVED_STATES", states)
        patch.setattr(reobservation, "COPIED_ROWS", states)
        patch.setattr(scratch_arrays, "MEMORY_BYTES", 0)
        patch.setattr(mapped_pages, "READ_BYTES", 1)
        again = data.reobserve(*models, progress=False)
        assert np.array_equal(again.moments.observation_std, whole.moments.observation_std)
    for name in reobservation.OBSERVED_ARRAYS:
        values = again.stored.arrays[name]
        assert isinstance(mapping_of(values), ScratchMap)
        assert not values.flags.writeable
        assert np.array_equal(values, whole.stored.arrays[name]), name


@pytest.mark.usefixtures("tight")
def test_only_rows_of_arrays_that_are_given_back_are_counted(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reobservations counted rows in memory that they wrote, so that what they wrote stayed."""
    counted: list[NDArray[Any]] = []
    given_back: list[NDArray[Any]] = []
    made = MappedReads.__init__

    def make(self: MappedReads, arrays: Iterable[NDArray[Any]]) -> None:
        given_back.extend(kept := [*arrays])
        made(self, kept)

    monkeypatch.setattr(MappedReads, "__init__", make)
    monkeypatch.setattr(MappedReads, "add", lambda self, *rows: counted.extend(rows))
    data = Dataset.open(tiny)
    data.reobserve("lidar-8", progress=False)
    data.with_rewards(robot_collision=2.0)
    in_frame(data, "target")
    subsample_dataset(data, tmp_path / "few", id="coop_nav-few-v0", n_steps=20)
    export_dataset(data, tmp_path / "few.hdf5", format="d4rl")
    assert all(any(np.may_share_memory(rows, a) for a in given_back) for rows in counted)


@pytest.mark.usefixtures("tight")
def test_computed_arrays_in_files_travel_to_other_processes(tiny: Path) -> None:
    seen = Dataset.open(tiny).reobserve("lidar-8", progress=False)
    again = pickle.loads(pickle.dumps(seen))
    assert np.array_equal(again.stored.arrays["observations"], seen.stored.arrays["observations"])


@pytest.mark.slow
@pytest.mark.usefixtures("tight")
def test_files_of_computed_arrays_go_with_their_last_view(cache_folder: Path) -> None:
    arrays = new_arrays({"a": ((3, 5), np.dtype(np.float32)), "b": ((0, 2), np.dtype(np.bool_))})
    arrays["a"][...] = 7
    view = arrays["a"][1:]
    del arrays
    gc.collect()
    assert (view == 7).all()
    assert list(cache_folder.iterdir()) == []  # the file has no name


@pytest.mark.usefixtures("tight")
def test_a_cache_that_cannot_be_written_to_holds_no_arrays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "file" / "cache"))
    assert len(new_arrays({"a": ((3,), np.dtype(np.float32))})["a"]) == 3
