from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.views import outcome_mask, policy_mask, split_mask
from swarmdata.errors import UnknownNameError
from swarmdata.store import SPLITS, StoredDataset, open_store
from swarmdata.testing.synthetic import make_dataset


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> StoredDataset:
    path: Path = tmp_path_factory.mktemp("splits") / "ds"
    make_dataset(path, [[1] * 40, [2] * 40], n_steps=60)
    return open_store(path)


def test_split_masks_partition(stored: StoredDataset) -> None:
    masks = [split_mask(stored.table, name) for name in SPLITS]
    assert (np.sum(masks, axis=0) == 1).all()


def test_policy_masks_partition(stored: StoredDataset) -> None:
    masks = [policy_mask(stored.table, stored.recipe, f"tag-{p}") for p in range(2)]
    assert (np.sum(masks, axis=0) == 1).all()
    assert all(mask.any() for mask in masks)


def test_outcome_bounds_are_included(stored: StoredDataset) -> None:
    value = float(stored.table.team_return[3])
    mask = outcome_mask(stored.table, min_return=value, max_return=value)
    assert mask.tolist() == (stored.table.team_return == value).tolist()
    assert outcome_mask(stored.table).all()


def test_success_and_failure_partition(stored: StoredDataset) -> None:
    masks = [outcome_mask(stored.table, success=value) for value in (True, False)]
    assert (np.sum(masks, axis=0) == 1).all()
    assert all(mask.any() for mask in masks)


def test_unknown_names(stored: StoredDataset) -> None:
    with pytest.raises(UnknownNameError, match="unknown split 'dev'"):
        split_mask(stored.table, "dev")
    with pytest.raises(UnknownNameError, match="Did you mean 'tag-1'"):
        policy_mask(stored.table, stored.recipe, "tag-11")
