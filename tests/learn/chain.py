"""A chain of two states whose values are known: 0 leads to 1, 1 leads to 0 or to the end."""

import numpy as np

from swarmdata.types import Episode, Float
from tests.support.made_episodes import made_episode
from tests.support.memory_dataset import MemoryDataset

N_AGENTS = 2


class Constant:
    """A team that always does the same."""

    def __init__(self, action: float) -> None:
        self.action = action

    def actions(self, observations: Float) -> Float:
        return np.full((*observations.shape[:2], 1), self.action, dtype=np.float32)


def episode(rng: np.random.Generator, length: int, first: int, *, ends: bool) -> Episode:
    """Random actions; the reward is the robot's action in state 0, twice that in state 1."""
    states = (np.arange(length + 1) + first) % 2
    actions = rng.uniform(-1, 1, (length, N_AGENTS, 1)).astype(np.float32)
    return made_episode(
        np.tile(states[:, None, None], (1, N_AGENTS, 1)), states[:, None], actions,
        actions[..., 0] * (1 + states[:-1, None]), ends=ends,
    )  # fmt: skip


def chain(n_episodes: int, *, ends: bool, seed: int = 0) -> MemoryDataset:
    """Episodes that end in state 1 (2 or 4 steps from state 0), or are cut after 3 steps."""
    rng = np.random.default_rng(seed)
    if ends:
        return MemoryDataset([episode(rng, 2, 0, ends=True) for _ in range(n_episodes)])
    return MemoryDataset([episode(rng, 3, k % 2, ends=False) for k in range(n_episodes)])
