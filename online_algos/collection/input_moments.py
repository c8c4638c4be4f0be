"""Means and deviations that normalize network inputs, measured under random actions."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.types import Double, Float

CONSTANT_STD = 1e-3
"""Features with a smaller deviation count as constant: they are centered, not scaled."""

MIN_STD = 0.05
"""Smallest deviation of other features: training may vary them much more than random actions do."""


N_MEASURED = 64
"""Steps of every copy that measure the inputs, where no setting says how many."""


class InputMoments(NamedTuple):
    """Mean and standard deviation of every feature, by seed.

    Those that are measured here are float32, and the deviation of constant features is 1; those of
    an offline run are float64, as its policies have them.
    """

    observation_mean: Float | Double  # [K, O]
    observation_std: Float | Double  # [K, O]
    state_mean: Float | Double  # [K, S]
    state_std: Float | Double  # [K, S]


class SeedNormalizer:
    """Inputs in units of the moments of their seed, in float32."""

    def __init__(self, moments: InputMoments) -> None:
        o_mean, o_std, s_mean, s_std = (torch.from_numpy(m).float()[:, None] for m in moments)
        self.state_mean, self.state_std = s_mean, s_std  # each [K, 1, S]
        self._observation_mean, self._observation_std = o_mean[:, None], o_std[:, None]

    def observations(self, observations: Tensor) -> Tensor:
        """Returns normalized observations, [K, B, N, O]."""
        return standardize(observations, self._observation_mean, self._observation_std)

    def states(self, states: Tensor) -> Tensor:
        """Returns normalized states, [K, B, S]."""
        return standardize(states, self.state_mean, self.state_std)


def measure_moments(
    worlds: Worlds, generators: Sequence[torch.Generator], n_steps: int
) -> InputMoments:
    """Takes `n_steps` uniform random steps, measures what is seen, and begins new episodes.

    The moments of a seed depend on its own one of K generators, and on its episodes only. Training
    freezes them, so that an actor is one fixed function.
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
        step = worlds.advance(torch.stack(actions).cpu().numpy())
        step_observations, step_states = worlds.observations(step), worlds.grouped(step.states)
        for k in range(worlds.n_seeds):
            observations[k].add(step_observations[k])
            states[k].add(step_states[k])
    worlds.restart()
    mean, std = (np.stack(m) for m in zip(*(s.moments() for s in observations), strict=True))
    state_mean, state_std = (np.stack(m) for m in zip(*(s.moments() for s in states), strict=True))
    return InputMoments(mean, std, state_mean, state_std)


class _Sums:
    """Sums of the rows of one seed, in float64."""

    def __init__(self) -> None:
        self.n_rows = 0
        self.first: Double = np.zeros(1)
        self.second: Double = np.zeros(1)

    def add(self, values: Float) -> None:
        """Adds values [..., F] as rows."""
        rows = values.reshape(-1, values.shape[-1]).astype(np.float64)
        self.n_rows += len(rows)
        self.first = self.first + rows.sum(axis=0)
        self.second = self.second + np.square(rows).sum(axis=0)

    def moments(self) -> tuple[Float, Float]:
        """Mean and standard deviation, [F]."""
        mean = self.first / self.n_rows
        std = np.sqrt(np.maximum(self.second / self.n_rows - mean * mean, 0.0))
        std = np.where(std < CONSTANT_STD, 1.0, np.maximum(std, MIN_STD))
        return mean.astype(np.float32), std.astype(np.float32)
