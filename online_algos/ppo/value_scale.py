"""ValueScale, the running scale of what a critic learns."""

import numpy as np
import torch
from torch import Tensor

from swarmdata.types import Double, Float


class ValueScale:
    """Mean and standard deviation of the value targets of each seed, averaged over updates.

    Yu et al. 2022, section 5.1, value normalization.

    Args:
        n_seeds: K.
        decay: weight of the past in each update.
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

    def tensor(self) -> Tensor:
        """The moments, for a checkpoint."""
        return torch.from_numpy(self.moments.copy())
