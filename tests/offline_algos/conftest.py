"""A tiny task: 2 point robots on a line segment each, one step from optimal actions."""

from importlib.util import find_spec

import numpy as np
import pytest

from swarmdata.types import Double, Episode, Float
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset

N_AGENTS, LENGTH = 2, 12

collect_ignore_glob = ["test_*.py"] if find_spec("torch") is None else []


def play(rng: np.random.Generator, good: bool, cut: bool) -> Episode:
    """Points with goals: a good policy drives at its goal, with noise; a bad one at random.

    Rewards are each robot's progress. The last step is a truncation if `cut`, else a termination.
    """
    positions = rng.uniform(-1, 1, (N_AGENTS, 2))
    goals = rng.uniform(-1, 1, (N_AGENTS, 2))
    observations, states, actions, rewards = [], [], [], []
    for t in range(LENGTH + 1):
        observations.append(np.concatenate([positions, goals - positions], 1))
        states.append(np.concatenate([positions, goals], 1).ravel())
        if t == LENGTH:
            break
        action = rng.uniform(-1, 1, (N_AGENTS, 2))
        if good:
            action = drive(goals - positions) + rng.normal(0, 0.3, (N_AGENTS, 2))
        action = action.clip(-1, 1)
        before = np.linalg.norm(goals - positions, axis=1)
        positions = (positions + 0.2 * action).clip(-1.5, 1.5)
        rewards.append(before - np.linalg.norm(goals - positions, axis=1))
        actions.append(action)
    return made_episode(observations, states, actions, rewards, ends=not cut, policy=int(good))


def drive(offsets: Double | Float) -> Double:
    """Velocity commands towards a goal: full speed until 0.2 away."""
    distances = np.linalg.norm(offsets, axis=-1, keepdims=True)
    return np.asarray(offsets / np.maximum(distances, 0.2), dtype=np.float64)


@pytest.fixture(scope="session")
def mixture() -> MemoryDataset:
    """Half good, half bad episodes, [200 episodes of 12 steps]."""
    rng = np.random.default_rng(0)
    return MemoryDataset([play(rng, good=i % 2 == 0, cut=i % 3 != 0) for i in range(200)])


@pytest.fixture(scope="session")
def good_only() -> MemoryDataset:
    """Good episodes only."""
    rng = np.random.default_rng(1)
    return MemoryDataset([play(rng, good=True, cut=True) for _ in range(200)])
