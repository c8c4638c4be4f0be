"""Training of algorithms of factored values on the tiny task of `conftest`."""

from typing import Any

import numpy as np

from swarmdata.learn.sizes import Sizes
from swarmdata.learn.statistics import Statistics
from swarmdata.testing.memory import MemoryDataset
from swarmdata.types import Batch, Float

SEEDS = (0, 1)
SMALL = {
    "hidden": (32, 32),
    "discount": 0.9,
    "batch_size": 128,
    "step_size": 3e-3,
    "temperature": 0.1,
    "threshold": 0.3,
}


def trained(
    kind: Any, data: MemoryDataset, n_updates: int, **config: Any
) -> tuple[Any, list[dict[str, float]]]:
    """Returns the algorithm and its losses, means over seeds, of every tenth update."""
    settings = kind.Config(**{**SMALL, "n_updates": n_updates, **config})
    samplers = [data.sampler(settings.batch_size, seed=seed) for seed in SEEDS]

    def draw() -> Batch:
        return samplers[0].gather(np.stack([s.draw() for s in samplers])).to_torch()

    statistics = Statistics.measure(data, settings.discount)
    algorithm = kind(Sizes.of(draw()), SEEDS, settings, statistics=statistics)
    losses = []
    for _ in range(n_updates):
        each = {name: float(loss.mean()) for name, loss in algorithm.update(draw()).items()}
        losses += [each] if "greedy_q" in each else []
    return algorithm, losses


def progress_of(actions: Float, observations: Float) -> float:
    """Mean progress of one step at the dataset's observations; straight at the goal gives 0.16."""
    offsets = observations[..., 2:4]
    before = np.linalg.norm(offsets, axis=-1)
    return float((before - np.linalg.norm(offsets - 0.2 * actions, axis=-1)).mean())
