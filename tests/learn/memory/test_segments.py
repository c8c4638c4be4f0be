"""Which steps of windows are learned from, and what is remembered there."""

from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates
from swarmdata.learn.memory.segments import (
    learned_rows,
    learned_steps,
    remembered,
    remembered_next,
    take,
)
from swarmdata.learn.networks.perceptrons import initialize
from tests.offline_algos.conftest import play
from tests.support.memory_dataset import MemoryDataset

BURN_IN, WINDOW = 3, 5


@pytest.fixture(scope="module")
def mixture() -> MemoryDataset:
    """Twenty episodes of 12 steps."""
    rng = np.random.default_rng(0)
    return MemoryDataset([play(rng, good=True, cut=True) for _ in range(20)])


def gates(parameters: Any, n_agents: int = 2, n_features: int = 4) -> StackedGates:
    shared = parameters == "shared"
    shape = GatedShape(n_features + (n_agents if shared else 0), 6)
    network = StackedGates(shape, 1 if shared else n_agents, "cpu")
    initialize(network, [0], 0)
    return network


def test_a_short_segment_is_filled_evenly() -> None:
    mask = torch.tensor([[[0, 0, 1, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 0, 0, 0]]], dtype=torch.bool)
    rows = learned_rows(mask, WINDOW)
    assert rows.tolist() == [[3, 4, 5, 6, 7, 11, 11, 11, 12, 12]]


def test_padding_is_never_learned_from(mixture: MemoryDataset) -> None:
    sampler = mixture.sampler(64, horizon=WINDOW, burn_in=BURN_IN, seed=0)
    batch = sampler.gather(sampler.draw()[None]).to_torch()
    assert not batch.mask.all()
    batch.observations[~batch.mask] = torch.nan
    steps = learned_steps(batch, learned_rows(batch.mask, WINDOW))
    assert steps.mask.all()
    assert steps.mask.shape == (1, 64 * WINDOW)
    assert steps.observations.isfinite().all()


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_padding_does_not_leak_into_memories(mixture: MemoryDataset, parameters: Any) -> None:
    sampler = mixture.sampler(64, horizon=WINDOW, burn_in=BURN_IN, seed=0)
    batch = sampler.gather(sampler.draw()[None]).to_torch()
    network = gates(parameters)
    clean = remembered(network, batch.observations, batch.mask, parameters)
    spoiled = batch.observations.clone()
    spoiled[~batch.mask] = torch.nan
    found = remembered(network, spoiled, batch.mask, parameters)
    rows = learned_rows(batch.mask, WINDOW)
    assert torch.equal(take(found, rows), take(clean, rows))
    network.backward(take(found, rows).square().sum())
    assert network.gradient.isfinite().all()
    assert network.gradient.norm() > 0


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_memory_begins_with_the_episode(mixture: MemoryDataset, parameters: Any) -> None:
    """In a segment less than `burn_in` after its episode's start, it is that of acting."""
    sampler = mixture.sampler(1, horizon=WINDOW, burn_in=WINDOW, seed=0)
    batch = sampler.gather(np.array([[7]])).to_torch()  # steps 5 to 9 of the first episode
    assert batch.mask.all()
    network, episode = gates(parameters), torch.tensor(mixture.episodes[0].observations)
    found = remembered(network, batch.observations, batch.mask, parameters)
    memory = torch.zeros(1, 1, 2, 6)
    for t in range(10):
        memory = remembered_next(network, episode[None, None, t], memory, parameters)
        torch.testing.assert_close(found[:, :, t], memory)
    first = sampler.gather(np.array([[2]])).to_torch()  # padding, then steps 0 to 4
    assert first.mask.tolist() == [[[False] * 5 + [True] * 5]]
    early = remembered(network, first.observations, first.mask, parameters)
    torch.testing.assert_close(early[:, :, 5:], found[:, :, :5])


def test_every_step_of_the_data_counts_the_same(mixture: MemoryDataset) -> None:
    """Draws of all transitions once: each step is learned from equally often."""
    window = 4  # divides the 12 steps of an episode
    sampler = mixture.sampler(1, horizon=window, burn_in=2, seed=0)
    batch = sampler.gather(np.arange(24)[None]).to_torch()
    steps = learned_steps(batch, learned_rows(batch.mask, window))
    _, counts = steps.observations[0, :, 0, 0].unique(return_counts=True)
    assert counts.tolist() == [window] * 24
