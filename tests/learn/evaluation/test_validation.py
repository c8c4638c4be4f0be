"""Validation losses against closed cases."""

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="losses need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.evaluation.fqe import (  # noqa: E402
    BATCH_SIZE,
    Answered,
    imitation_error,
    td_errors,
    weighted_imitation_error,
)
from swarmdata.learn.evaluation.transitions import Transitions  # noqa: E402
from swarmdata.learn.networks.dataset_statistics import Statistics  # noqa: E402
from swarmdata.learn.networks.setup import Setup  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.learn.chain import N_AGENTS, Constant, chain  # noqa: E402

ACTIONS = (0.25, -0.5)


def asked(dataset: MemoryDataset, discount: float) -> Answered:
    data = Transitions.read(dataset, Statistics.measure(dataset, discount), discount)
    return Answered.by([Constant(action) for action in ACTIONS], dataset, data)


def errors(dataset: MemoryDataset) -> Any:
    """Per policy and transition, mean over robots and components."""
    recorded = dataset.transitions["actions"].astype(np.float64)
    return np.stack([np.square(action - recorded).mean((1, 2)) for action in ACTIONS])


def test_the_imitation_error_is_the_loss_of_cloning() -> None:
    dataset = chain(5, ends=True)
    found = imitation_error(asked(dataset, 0.5))
    np.testing.assert_allclose(found, errors(dataset).mean(1), rtol=1e-5)


def test_what_went_well_weighs_more() -> None:
    """At discount 0 the return-to-go is the reward itself."""
    dataset = chain(5, ends=True)
    rewards = dataset.transitions["rewards"].mean(1, dtype=np.float64)
    weights = np.exp((rewards - rewards.mean()) / rewards.std())
    expected = (errors(dataset) * weights).sum(1) / weights.sum()
    found = weighted_imitation_error(asked(dataset, 0.0))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_equal_returns_weigh_the_same() -> None:
    dataset = chain(4, ends=True)
    for each in dataset:
        each.rewards[:] = 0.0
    split = asked(dataset, 0.9)
    np.testing.assert_allclose(weighted_imitation_error(split), imitation_error(split))


class WithCritics:
    """Says that its first seed is off by 3, its second by 5."""

    def td_error(self, batch: Batch) -> Tensor:
        assert batch.rewards.shape == (2, BATCH_SIZE, N_AGENTS)
        assert torch.equal(batch.states[0], batch.states[1])
        return torch.tensor([9.0, 25.0])


def test_td_errors_are_in_units_of_rewards() -> None:
    found = td_errors(WithCritics(), chain(5, ends=True), 2, 0.5, "cpu")
    assert found is not None
    np.testing.assert_allclose(found, [1.5, 2.5])
    assert td_errors(object(), chain(5, ends=True), 2, 0.5, "cpu") is None


def test_the_td_error_of_maddpg_bc_is_its_critics_loss_and_changes_nothing() -> None:
    dataset = chain(8, ends=False)
    batch = dataset.sampler(32).gather(np.arange(24)[None]).to_torch()
    config = MADDPGBCConfig(
        actor_hidden=(8,), critic_hidden=(8,), smoothing=0.0, max_grad_norm=None
    )
    statistics = Statistics.measure(dataset, config.discount)
    algorithm = MADDPGBC(Setup(Sizes.of(batch), [3], statistics), config)
    before = algorithm.critics.online.flat.clone()
    found = algorithm.td_error(batch)
    assert torch.equal(algorithm.critics.online.flat, before)
    loss = algorithm.update(batch)["critic_loss"]
    torch.testing.assert_close(found, loss / 2)  # the loss is the sum over two critics
