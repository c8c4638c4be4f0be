"""An environment whose agents observe images, and a recording of it."""

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from pettingzoo import ParallelEnv

from swarmdata.datasets.dataset import Dataset
from swarmdata.record import Recorder

SHAPE = (12, 16, 3)
LENGTH = 9


class Painting(ParallelEnv):  # type: ignore[misc]
    """Each agent sees a bright square that moves one pixel to the right in every step."""

    def __init__(self) -> None:
        self.metadata = {"name": "painting_v1"}
        self.possible_agents = ["left", "right"]
        self.agents: list[str] = []
        self.time = 0

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(0, 255, SHAPE, np.uint8)

    def action_space(self, agent: str) -> Space[Any]:
        return Discrete(3)

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.time, self.agents = 0, list(self.possible_agents)
        return self._observe(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        names, self.time = self.agents, self.time + 1
        over = self.time == LENGTH
        self.agents = [] if over else names
        rewards = {agent: float(actions[agent]) for agent in names}
        no, cut = dict.fromkeys(names, False), dict.fromkeys(names, over)
        return self._observe(), rewards, no, cut, {agent: {} for agent in names}

    def _observe(self) -> dict[str, Any]:
        images = {}
        for index, agent in enumerate(self.possible_agents):
            image = np.full(SHAPE, 20, np.uint8)
            image[4:8, self.time : self.time + 4, index] = 255
            images[agent] = image
        return images


def record_images(
    path: Path, n_episodes: int = 3, id: str = "painting_v1-mine-v0", **metadata: str
) -> Dataset:
    """Records episodes in which both agents repeat the actions 0, 1, 2."""
    env = Painting()
    with Recorder(env, id=id, path=path, metadata=metadata) as recorder:
        for _ in range(n_episodes):
            recorder.reset()
            while recorder.agents:
                recorder.step(dict.fromkeys(recorder.agents, env.time % 3))
    return recorder.close()
