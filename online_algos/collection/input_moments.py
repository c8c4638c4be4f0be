"""What the networks of online algorithms see is normalized by what random actions lead to."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from swarmdata.errors import SchemaError
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.types import Double, Float

CONSTANT = 1e-3
"""Features that deviate less than this count as constant: they are centered, not scaled."""

LEAST = 0.05
"""Least deviation of others: what random actions hardly vary may vary much more later."""


class Moments(NamedTuple):
    """Mean and standard deviation of every feature, per seed; 1 is the deviation of constants."""

    observation_mean: Float  # [K, O]
    observation_std: Float  # [K, O]
    state_mean: Float  # [K, S]
    state_std: Float  # [K, S]


def measure_moments(worlds: Worlds, generators: Sequence[torch.Generator], n_steps: int) -> Moments:
    """Takes uniform random actions and measures what is seen, then begins new episodes.

    The figures of a seed depend on its generator and its episodes only. They are to be frozen: a
    trained actor is then one fixed function.

    Args:
        worlds: where to act; moved on by `n_steps`, then restarted.
        generators: of the actions, one per seed, [K].
        n_steps: steps of every copy.

    Raises:
        SchemaError: the number of generators or of steps is wrong.
    """
    if len(generators) != worlds.n_seeds or n_steps < 1:
        raise SchemaError(
            f"got {len(generators)} generators and {n_steps} steps, expected {worlds.n_seeds} "
            "generators, one per seed, and at least one step"
        )
    shape = (worlds.n_copies, worlds.sizes.n_agents, worlds.sizes.action)
    observations, states = [_Sums() for _ in generators], [_Sums() for _ in generators]
    for _ in range(n_steps):
        actions = [2 * torch.rand(shape, generator=g, device=g.device) - 1 for g in generators]
        reached = worlds.advance(torch.stack(actions).cpu().numpy())
        seen, known = worlds.seen(reached), worlds.grouped(reached.states)
        for k in range(worlds.n_seeds):
            observations[k].add(seen[k])
            states[k].add(known[k])
    worlds.restart()
    mean, std = (np.stack(m) for m in zip(*(s.moments() for s in observations), strict=True))
    state_mean, state_std = (np.stack(m) for m in zip(*(s.moments() for s in states), strict=True))
    return Moments(mean, std, state_mean, state_std)


class _Sums:
    """Sums of the rows of one seed, in float64."""

    def __init__(self) -> None:
        self.n_rows = 0
        self.first: Double = np.zeros(1)
        self.second: Double = np.zeros(1)

    def add(self, values: Float) -> None:
        """Counts values [..., F] as rows."""
        rows = values.reshape(-1, values.shape[-1]).astype(np.float64)
        self.n_rows += len(rows)
        self.first = self.first + rows.sum(axis=0)
        self.second = self.second + np.square(rows).sum(axis=0)

    def moments(self) -> tuple[Float, Float]:
        """Mean and standard deviation, [F]."""
        mean = self.first / self.n_rows
        std = np.sqrt(np.maximum(self.second / self.n_rows - mean * mean, 0.0))
        std = np.where(std < CONSTANT, 1.0, np.maximum(std, LEAST))
        return mean.astype(np.float32), std.astype(np.float32)
