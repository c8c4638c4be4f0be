"""LearnedDeviation: standard deviations of actions that are learned with the actors."""

import math

import torch
from torch import Tensor

from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP


class LearnedDeviation:
    """One standard deviation of each component of each actor's actions, the same in every state.

    (Schulman et al. 2017, section 6.1; the code of Yu et al. 2022.)

    Attributes:
        network: the logarithms, as networks without inputs; its rows are those of the actors.

    Args:
        n_rows: actors of all seeds, R.
        action_size: components, A.
        initial: standard deviation at the start.
    """

    def __init__(self, n_rows: int, action_size: int, initial: float) -> None:
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
