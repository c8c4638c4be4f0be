"""A made-up task with two episodes; without torch, no test of online algorithms is collected."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Int, Seeds, Step, blank_step

N_AGENTS = 2


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    return True if collection_path.suffix == ".py" and find_spec("torch") is None else None


class TwoEpisodes:
    """Copies whose episodes last 3 steps; even copies terminate, odd ones are truncated.

    Every observation and state is (episode modulo 4, time in the episode, kind), so that
    a transition tells where it comes from. The reward of each robot is the time of the step taken.
    """

    def __init__(self, n_copies: int) -> None:
        self.spec = TaskSpec.parse({"horizon": 3, "team": [{"count": N_AGENTS}]})
        self.task: Any = None
        self.n_copies = n_copies
        self.features = tuple(Feature(name, "flag") for name in ("episode", "time", "kind"))
        self.observation_size, self.action_size, self.state_size = 3, 2, 3
        self._episodes = np.zeros(n_copies, np.int64)
        self._times = np.zeros(n_copies, np.int64)
        self._seeds: Seeds = np.zeros(n_copies, np.uint64)

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        chosen = np.arange(self.n_copies) if copies is None else copies
        self._episodes[chosen] += 1
        self._times[chosen] = 0
        self._seeds[chosen] = seeds
        return self._step(np.zeros(self.n_copies, np.bool_))

    def step(self, actions: Any) -> Step:
        assert actions.shape == (self.n_copies, N_AGENTS, 2)
        self._times += 1
        return self._step(self._times == 3)

    def _step(self, ended: np.ndarray) -> Step:
        even = np.arange(self.n_copies) % 2 == 0
        states = np.stack([self._episodes % 4, self._times, even], -1).astype(np.float32)
        observations = np.repeat(states[:, None], N_AGENTS, 1)
        rewards = np.repeat(self._times[:, None], N_AGENTS, 1).astype(np.float32)
        flags = {"terminations": ended & even, "truncations": ended & ~even}
        clock = {"seeds": self._seeds.copy(), "times": self._times.copy()}
        return blank_step(observations, states, rewards=rewards, **flags, **clock)


@pytest.fixture
def two_episodes() -> TwoEpisodes:
    """Four copies of it."""
    return TwoEpisodes(4)
