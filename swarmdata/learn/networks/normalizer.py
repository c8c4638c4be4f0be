"""Normalizer: what the networks of offline algorithms see, by the moments of the dataset."""

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.learn.training.dataset_statistics import Statistics


class Normalizer:
    """The moments of a dataset on a device, in float32.

    Args:
        statistics: of the dataset.
        device: where batches are.
    """

    def __init__(self, statistics: Statistics, device: torch.device | str) -> None:
        def here(moment: object) -> Tensor:
            return torch.tensor(moment).to(device, torch.float32)

        self.state_mean, self.state_std = here(statistics.state_mean), here(statistics.state_std)
        self.observation_mean = here(statistics.observation_mean)
        self.observation_std = here(statistics.observation_std)

    def states(self, states: Tensor) -> Tensor:
        """Returns normalized states, [..., S], of states as recorded."""
        return standardize(states, self.state_mean, self.state_std)

    def observations(self, observations: Tensor) -> Tensor:
        """Returns normalized observations, [..., O], of observations as recorded."""
        return standardize(observations, self.observation_mean, self.observation_std)
