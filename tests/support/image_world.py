"""An environment whose agents observe images, and a recording of it."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete, Space

from swarmdata.datasets.dataset import Dataset
from tests.record.worlds import Together, record

SHAPE = (12, 16, 3)
LENGTH = 9


class Painting(Together):
    """Each agent sees a bright square that moves one pixel to the right in every step."""

    NAME, length = "painting_v1", LENGTH
    ACTIONS: ClassVar[dict[str, Space[Any]]] = {"left": Discrete(3), "right": Discrete(3)}

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(0, 255, SHAPE, np.uint8)

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        return {agent: float(action) for agent, action in actions.items()}

    def observe(self) -> dict[str, Any]:
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
    return record(Painting(), path, n_episodes, lambda _, time: time % 3, id=id, metadata=metadata)
