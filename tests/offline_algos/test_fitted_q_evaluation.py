"""Fitted Q evaluation of policies on the tiny task, against what they earn when they are played."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="critics need torch")

from swarmdata.learn.evaluation.fqe import Answered, FQEConfig, fitted_q_evaluation  # noqa: E402
from swarmdata.learn.evaluation.transitions import Transitions  # noqa: E402
from swarmdata.learn.networks.dataset_statistics import Statistics, returns_to_go  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.types import Double, Float  # noqa: E402

DISCOUNT = 0.9


class Driver:
    """Drives at its goal at a fraction of full speed; a negative one drives away."""

    def __init__(self, speed: float) -> None:
        self.speed = speed

    def actions(self, observations: Float) -> Float:
        """The distance is 2.8 at most, and progress stops at the goal."""
        offsets = observations[..., 2:4]
        distances = np.linalg.norm(offsets, axis=-1, keepdims=True)
        return (self.speed * offsets / np.maximum(distances, 0.2)).astype(np.float32)

    def earns(self, observations: Float) -> float:
        """Discounted team return of 60 steps from first observations [E, N, O], simulated."""
        positions: Double = observations[..., :2].astype(np.float64)
        goals = positions + observations[..., 2:4]
        rewards = []
        for _ in range(60):
            before = np.linalg.norm(goals - positions, axis=-1)
            seen = np.concatenate([positions, goals - positions], -1).astype(np.float32)
            positions = (positions + 0.2 * self.actions(seen)).clip(-1.5, 1.5)
            rewards.append((before - np.linalg.norm(goals - positions, axis=-1)).mean())
        return float(returns_to_go(rewards, DISCOUNT)[0])


@pytest.mark.learns
def test_policies_are_worth_what_they_earn(mixture: MemoryDataset) -> None:
    drivers = [Driver(speed) for speed in (1.0, 0.6, 0.3)]
    episodes = [episode for episode in mixture if not episode.terminations.any()]
    dataset = MemoryDataset(episodes)  # those that end do so where a driver would go on
    statistics = Statistics.measure(dataset, DISCOUNT)
    data = Transitions.read(dataset, statistics, DISCOUNT)
    split = Answered.by(drivers, dataset, data)
    config = FQEConfig(n_updates=1500, hidden=(64, 64), discount=DISCOUNT)
    values = fitted_q_evaluation(split, split, statistics.return_std, config, progress=False)
    first = np.stack([episode.observations[0] for episode in dataset])
    earned = [driver.earns(first) for driver in drivers]
    assert sorted(values.mean, reverse=True) == list(values.mean)
    np.testing.assert_allclose(values.mean, earned, rtol=0.1)
