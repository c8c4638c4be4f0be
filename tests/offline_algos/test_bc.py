"""Behavior cloning: its loss, its schedule, and that it imitates."""

from itertools import islice
from typing import Any

import numpy as np
import pytest

from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.types import Batch
from tests.offline_algos.conftest import drive
from tests.offline_algos.toys import actions_of, batches
from tests.support.memory_dataset import MemoryDataset


def made(dataset: MemoryDataset, n_seeds: int, **changes: Any) -> tuple[BC, list[Batch]]:
    config = BCConfig(**{"hidden": (32, 32), "n_updates": 400, "batch_size": 64, **changes})
    drawn = list(islice(batches(dataset, config, range(n_seeds)), config.n_updates))
    statistics = Statistics.measure(dataset, config.discount)
    return BC(Setup(Sizes.of(drawn[0]), range(n_seeds), statistics), config), drawn


@pytest.mark.parametrize("output", ["tanh", "clip"])
def test_the_loss_is_the_mean_squared_error_of_the_policy(
    good_only: MemoryDataset, output: str
) -> None:
    bc, batches = made(good_only, 2, n_updates=1, output=output)
    batch = batches[0]
    outputs = actions_of(bc.policy(1), batch.observations[1].numpy())  # before the update
    loss = bc.update(batch)["bc_loss"]
    if output == "tanh":  # clipped outputs differ from those that are trained
        expected = np.square(outputs - batch.actions[1].numpy()).mean()
        assert loss[1].item() == pytest.approx(expected, rel=1e-5)
    assert loss.shape == (2,)


def test_it_follows_the_cosine_and_stands_still_at_its_end(good_only: MemoryDataset) -> None:
    bc, batches = made(good_only, 1, n_updates=10)
    moved = []
    for batch in [*batches, batches[0]]:
        before = bc.actor.network.flat.clone()
        bc.update(batch)
        moved.append((bc.actor.network.flat - before).abs().max().item())
    assert moved[0] == pytest.approx(BCConfig().learning_rate, rel=0.01)
    assert 0 < moved[9] < 0.1 * moved[0]
    assert moved[10] == 0


@pytest.mark.learns
@pytest.mark.parametrize("output", ["tanh", "clip"])
def test_it_imitates_each_agent(good_only: MemoryDataset, output: str) -> None:
    """The error against the noise-free behavior policy falls to a fraction of the noise (0.3)."""
    bc, batches = made(good_only, 3, n_updates=2000, output=output)
    for batch in batches:
        bc.update(batch)
    observations = good_only.transitions["observations"]
    for index in range(3):
        error = actions_of(bc.policy(index), observations) - drive(observations[..., 2:4])
        assert np.sqrt(np.square(error).mean()) < 0.1
