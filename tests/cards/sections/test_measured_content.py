"""Log-probabilities are summarized where they were recorded."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.cards.sections.measured_content import LOG_PROBS, card_data_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset, open_store


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> StoredDataset:
    folder = tmp_path_factory.mktemp("findings") / "data"
    return open_store(record(folder, TaskSpec(horizon=40), ("random", "idle")))


def with_log_probs(stored: StoredDataset) -> StoredDataset:
    """A random policy of density 1/4, and one without any."""
    lengths, policies = stored.table.lengths, stored.table.policy
    values = np.where(np.repeat(policies, lengths) == 0, np.log(0.25), -np.inf)
    spread = np.repeat(values[:, None], stored.recipe.spec.n_agents, axis=1).astype(np.float32)
    return replace(stored, arrays={**stored.arrays, LOG_PROBS: spread})


def test_log_probabilities_are_by_policy_where_there_are_some(stored: StoredDataset) -> None:
    found = card_data_of(with_log_probs(stored)).log_probs
    assert found is not None
    assert found[0].undefined == 0.0
    assert (found[0].mean, *found[0].quantiles) == pytest.approx([np.log(0.25)] * 4)
    assert found[1].undefined == 1.0
    assert np.isnan(found[1].mean)
    arrays = {name: array for name, array in stored.arrays.items() if name != LOG_PROBS}
    assert card_data_of(replace(stored, arrays=arrays)).log_probs is None
