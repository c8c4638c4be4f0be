"""The values that judge MAPPO's actors, their scale, and learned deviations of actions."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.actor import CRITIC_STREAM
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.online_algos.actors.sample_rows import sample_rows
from swarmdata.types import Double, Float


class ValueScale:
    """Mean and standard deviation of the value targets of each seed, averaged over updates.

    Yu et al. 2022, section 5.1, value normalization.
    """

    def __init__(self, n_seeds: int, decay: float = 0.99) -> None:
        self.decay = decay
        self.moments: Double = np.zeros((3, n_seeds))  # weight, mean, mean square

    def update(self, targets: Float) -> None:
        """Takes in the targets of one rollout, [T, K, E, N]."""
        by_seed = targets.astype(np.float64).swapaxes(0, 1).reshape(targets.shape[1], -1)
        new = np.stack([np.ones(len(by_seed)), by_seed.mean(1), np.square(by_seed).mean(1)])
        self.moments = self.decay * self.moments + (1 - self.decay) * new

    @property
    def mean(self) -> Double:
        """Mean of past targets, [K]."""
        mean: Double = self.moments[1] / np.maximum(self.moments[0], 1e-8)
        return mean

    @property
    def std(self) -> Double:
        """Standard deviation of past targets, at least 0.01, [K]."""
        square = self.moments[2] / np.maximum(self.moments[0], 1e-8)
        deviation: Double = np.sqrt(np.maximum(square - self.mean**2, 1e-4))
        return deviation

    def normalize(self, targets: Float) -> Float:
        """Returns what the critic learns, [T, K, E, N]."""
        scaled = (targets - self.mean[:, None, None]) / self.std[:, None, None]
        return scaled.astype(np.float32)

    def denormalize(self, values: Float) -> Float:
        """Returns values in units of return, of a critic's outputs [..., K, E, N]."""
        scaled = values * self.std[:, None, None] + self.mean[:, None, None]
        return scaled.astype(np.float32)


class LearnedDeviation:
    """One standard deviation of each component of each actor's actions, the same in every state.

    (Schulman et al. 2017, section 6.1; the code of Yu et al. 2022.)
    """

    def __init__(self, n_rows: int, action_size: int, initial: float) -> None:
        # the logarithms, as networks without inputs; its rows are those of the actors
        self.network = StackedMLP(MLPShape(0, (), action_size), n_rows, "cpu")
        self.network.flat.fill_(math.log(initial))
        self._nothing = torch.zeros(n_rows, 1, 0)

    @property
    def std(self) -> Tensor:
        """The deviations, [R, 1, A], with the gradient of `network`."""
        return self.network(self._nothing).exp()

    @property
    def entropy(self) -> Tensor:
        """Entropy of each actor's noise, [R], in nats."""
        log_std = self.network(self._nothing)  # [R, 1, A]
        return (log_std + 0.5 * math.log(2 * math.pi * math.e)).sum((1, 2))


class Critic:
    """The values of K seeds, from a robot's inputs and its view of the state."""

    def __init__(self, n_inputs: int, seeds: Sequence[int], hidden: int) -> None:
        self.network = StackedMLP(MLPShape(n_inputs, (hidden, hidden), 1), len(seeds), "cpu")
        initialize(self.network, seeds, CRITIC_STREAM, method="orthogonal", head_gain=1.0)
        self.scale = ValueScale(len(seeds))

    def values(self, actor_inputs: Tensor, states: Tensor) -> Float:
        """Values in units of return, [T, K, E, N], of inputs [T, K, E, N, ...]; no gradient."""
        t, k, e, n = actor_inputs.shape[:4]
        with torch.no_grad():
            rows = self.network(sample_rows(torch.cat([actor_inputs, states], -1), "shared"))
        return self.scale.denormalize(rows.view(k, t, e, n).transpose(0, 1).numpy())
