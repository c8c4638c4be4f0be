"""Copies of episodes are the same rows, whatever is left out and in whichever pieces."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmdata.datasets.dataset import Dataset
from swarmdata.store import open_store
from swarmdata.store.arrays.layout import TIME_FIELDS
from swarmdata.store.episode_selection import Piece, Selection
from swarmdata.testing.synthetic import make_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("selection") / "ds"
    make_dataset(folder, [[3, 1, 7, 4, 2, 9, 1, 6], [5, 5, 1, 8, 1, 1, 3, 2]], n_steps=30)
    return Dataset.open(folder)


def test_the_whole_selection_is_the_dataset(dataset: Dataset) -> None:
    piece = Piece(dataset.stored, dataset.selection, {0: 0, 1: 1})
    source = Selection([piece])
    for name in TIME_FIELDS:
        rows = np.concatenate(list(source.blocks(name)))
        np.testing.assert_array_equal(rows, dataset.stored.arrays[name], name)
        assert source.row_shape(name) == rows.shape[1:]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_every_piece_gives_its_episodes(dataset: Dataset, data: st.DataObject) -> None:
    n = len(dataset)
    pieces = [sorted(data.draw(st.sets(st.integers(0, n - 1), min_size=1))) for _ in range(2)]
    source = Selection([Piece(dataset.stored, np.array(p), {0: 1, 1: 0}) for p in pieces])
    chosen = [k for piece in pieces for k in piece]
    assert len(source.table) == len(chosen)
    np.testing.assert_array_equal(source.table.policy, 1 - dataset.episodes.policy[chosen])
    for name in TIME_FIELDS:
        blocks = list(source.blocks(name))
        for block, k in zip(blocks, chosen, strict=True):
            np.testing.assert_array_equal(block, getattr(dataset[k], name))
    ends = np.cumsum(source.table.lengths)
    np.testing.assert_array_equal(source.table.starts, ends - source.table.lengths)


def test_unknown_arrays_of_newer_versions_are_left_out(dataset: Dataset, tmp_path: Path) -> None:
    stored = open_store(dataset.path)
    stored.arrays["new_kind"] = np.zeros(3)
    assert "new_kind" not in Selection([Piece(stored, np.arange(2), {0: 0, 1: 1})]).names
