"""The networks of MAPPO: the mean actions of K teams, and the values that judge them."""

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import standardize, with_agent_id
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.collection.input_moments import Moments
from swarmdata.online_algos.ppo.rollout_samples import sample_rows
from swarmdata.online_algos.ppo.value_scale import ValueScale
from swarmdata.perception.frames import Frame
from swarmdata.types import Double, Float

ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


class ActorWeights(NamedTuple):
    """All that decides the mean actions of K seeds."""

    parameters: Tensor  # [K, P] of shared actors, [K N, P] of separate ones
    input_mean: Float | Double  # [K, O]
    input_std: Float | Double  # [K, O]


class Actors:
    """The mean actions of K seeds' teams, from normalized observations.

    The input statistics are frozen from the start, so that a trained actor is one fixed piecewise
    linear function.

    Args:
        sizes: numbers of robots and features.
        seeds: of the initial parameters, [K].
        hidden: width of the two hidden layers.
        parameters: whether the robots of a seed share an actor, which then sees their number.
        moments: of the observations.

    Attributes:
        n_rows: actors of each seed.
    """

    def __init__(
        self, sizes: Sizes, seeds: Sequence[int], hidden: int, parameters: Parameters,
        moments: Moments,
    ) -> None:  # fmt: skip
        self.parameters = parameters
        self.n_rows = 1 if parameters == "shared" else sizes.n_agents
        n_inputs = sizes.observation + (sizes.n_agents if parameters == "shared" else 0)
        shape = MLPShape(n_inputs, (hidden, hidden), sizes.action)
        self.network = StackedMLP(shape, len(seeds) * self.n_rows, "cpu")
        initialize(self.network, seeds, ACTOR_STREAM, method="orthogonal", head_gain=0.01)
        self.input_mean, self.input_std = moments.observation_mean, moments.observation_std

    @property
    def weights(self) -> ActorWeights:
        """A copy of the weights."""
        return ActorWeights(
            self.network.flat.clone(), self.input_mean.copy(), self.input_std.copy()
        )

    def load(self, weights: ActorWeights) -> None:
        """Replaces the weights by copies of others."""
        self.network.load(weights.parameters)
        self.input_mean, self.input_std = weights.input_mean.copy(), weights.input_std.copy()

    def copy(self) -> "Actors":
        """Returns actors with equal weights in memory of their own."""
        twin = copy(self)
        twin.network = self.network.clone()
        twin.input_mean, twin.input_std = self.input_mean.copy(), self.input_std.copy()
        return twin

    def inputs(self, observations: Float) -> Tensor:
        """Normalized observations, [K, E, N, I]; with the robot's number if they share an actor."""
        moments = (self.input_mean, self.input_std)  # float64 of an offline run
        mean, std = (torch.from_numpy(m).float()[:, None, None] for m in moments)
        features = standardize(torch.from_numpy(observations), mean, std)
        return with_agent_id(features) if self.parameters == "shared" else features

    def means(self, inputs: Tensor) -> Tensor:
        """Mean actions, [K, E, N, A], of inputs [K, E, N, I]; no gradient."""
        with torch.no_grad():
            outputs = self.network(by_network(inputs, self.parameters))
        return from_rows(outputs, inputs.shape, self.parameters)

    def policy(self, index: int, frame: Frame | None) -> TorchPolicy:
        """The greedy policy of seed number `index`, a copy of its weights as they are now."""
        return TorchPolicy(
            layers=self.network.extract(index * self.n_rows, torch.float64, self.n_rows),
            observation_mean=torch.from_numpy(self.input_mean[index].astype(np.float64)),
            observation_std=torch.from_numpy(self.input_std[index].astype(np.float64)),
            squash=False,
            frame=frame,
            parameters=self.parameters,
        )


class Critic:
    """The values of K seeds, from a robot's inputs and its view of the state.

    Args:
        n_inputs: of one value.
        seeds: of the initial parameters, [K].
        hidden: width of the two hidden layers.
    """

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
