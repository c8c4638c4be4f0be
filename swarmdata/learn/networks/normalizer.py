"""Normalizer: inputs and rewards of offline algorithms in units of the dataset's deviations."""

import math

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import information, standardize
from swarmdata.learn.training.dataset_statistics import Statistics


class Normalizer:
    """The moments of a dataset on a device, in float32.

    Attributes:
        reward_scale: 1 / standard deviation of the returns-to-go.
        max_value: R*, the largest return-to-go, in scaled rewards; infinite if it bounds nothing.

    Args:
        statistics: of the dataset.
        device: where batches are.
        clip_target: whether R* bounds values.
    """

    def __init__(
        self, statistics: Statistics, device: torch.device | str, *, clip_target: bool = False
    ) -> None:
        def on_device(moment: object) -> Tensor:
            return torch.tensor(moment).to(device, torch.float32)

        self.state_mean = on_device(statistics.state_mean)
        self.state_std = on_device(statistics.state_std)
        self.observation_mean = on_device(statistics.observation_mean)
        self.observation_std = on_device(statistics.observation_std)
        self.reward_scale = 1 / statistics.return_std
        self.max_value = statistics.max_return * self.reward_scale if clip_target else math.inf

    def states(self, states: Tensor) -> Tensor:
        """Returns normalized states, [..., S], of states as recorded."""
        return standardize(states, self.state_mean, self.state_std)

    def observations(self, observations: Tensor) -> Tensor:
        """Returns normalized observations, [..., O], of observations as recorded."""
        return standardize(observations, self.observation_mean, self.observation_std)

    def information(self, states: Tensor, observations: Tensor) -> Tensor:
        """Returns x, [K, B, S + N O], of states [K, B, S] and observations [K, B, N, O]."""
        return information(self.states(states), self.observations(observations))
