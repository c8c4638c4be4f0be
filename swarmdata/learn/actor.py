"""StackedActor: the deterministic policies of K seeds, each shared by all agents."""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.learn.inputs import standardize, with_agent_id
from swarmdata.learn.networks import MLPShape, StackedMLP, initialize
from swarmdata.learn.policy import TorchPolicy
from swarmdata.learn.sizes import Sizes
from swarmdata.learn.statistics import Statistics

ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


class StackedActor:
    """Maps normalized observations and the agent's number to actions.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers.
        statistics: of the dataset, to normalize observations.
        squash: whether outputs pass through tanh; otherwise they are clipped when acting only.
        device: where the parameters are.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        statistics: Statistics,
        *,
        squash: bool,
        device: torch.device | str,
    ) -> None:
        shape = MLPShape(sizes.observation + sizes.n_agents, hidden, sizes.action)
        self.network = StackedMLP(shape, len(seeds), device)
        initialize(self.network, seeds, ACTOR_STREAM)
        self.squash = squash
        self._mean = torch.tensor(statistics.observation_mean, dtype=torch.float64)
        self._std = torch.tensor(statistics.observation_std, dtype=torch.float64)
        self._mean_here = self._mean.to(device, torch.float32)
        self._std_here = self._std.to(device, torch.float32)

    def inputs(self, observations: Tensor) -> Tensor:
        """Returns the network's input rows, [K, B N, O + N], of observations [K, B, N, O]."""
        standard = standardize(observations, self._mean_here, self._std_here)
        return with_agent_id(standard).flatten(1, 2)

    def __call__(self, observations: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns actions, [K, B, N, A], of observations [K, B, N, O].

        Args:
            observations: as recorded.
            network: other parameters to use, such as those of the target policy.
        """
        outputs = (network or self.network)(self.inputs(observations))
        actions = outputs.tanh() if self.squash else outputs
        return actions.view(*observations.shape[:3], -1)

    def policy(self, index: int) -> TorchPolicy:
        """Returns the policy of seed number `index`, a copy of its parameters as they are now."""
        return TorchPolicy(
            layers=self.network.extract(index, torch.float64),
            observation_mean=self._mean,
            observation_std=self._std,
            squash=self.squash,
        )
