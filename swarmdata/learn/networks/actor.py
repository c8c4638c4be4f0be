"""The deterministic policies of K seeds, each shared by all agents, and their slow copies."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.set_networks import SetShape, StackedSets
from swarmdata.learn.networks.setup import Setup
from swarmdata.perception.feature_slots import slots_of
from swarmdata.types import Batch

ACTOR_STREAM, CRITIC_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


PolicyNetwork = Literal["mlp", "deep_sets"]
"""A perceptron of the whole observation and the robot's number, or a network over sets."""


class StackedActor:
    """Maps normalized observations to actions; perceptrons see the agent's number too.

    Outputs pass through tanh (`squash`), or are clipped when acting only. The `policy_network`
    `deep_sets` reads the slots of an observation as sets (`set_networks`).
    """

    def __init__(
        self,
        setup: Setup,
        hidden: tuple[int, ...],
        *,
        squash: bool,
        policy_network: PolicyNetwork = "mlp",
    ) -> None:
        self.network: StackedMLP | StackedSets
        sizes, n_seeds, device = setup.sizes, setup.n_seeds, setup.device
        mean, std = setup.statistics.observation_mean, setup.statistics.observation_std
        if policy_network == "deep_sets":
            slots = slots_of(sizes.features, sizes.frame)
            self.field_moments = slots.moments(mean, std)
            mean, std = slots.normalizing(*self.field_moments)
            self.network = StackedSets(SetShape(slots, hidden, sizes.action), n_seeds, device)
        else:
            shape = MLPShape(sizes.observation + sizes.n_agents, hidden, sizes.action)
            self.network = StackedMLP(shape, n_seeds, device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        self.squash, self.sizes = squash, sizes
        self.standard = Standardization(mean, std, device)

    def inputs(self, observations: Tensor) -> Tensor:
        """Returns the network's rows, [K, B N, O + N], of sets [K, B N, O], of [K, B, N, O]."""
        standard = self.standard(observations)
        is_numbered = isinstance(self.network, StackedMLP)
        return (with_agent_id(standard) if is_numbered else standard).flatten(1, 2)

    def __call__(
        self, observations: Tensor, network: StackedMLP | StackedSets | None = None
    ) -> Tensor:
        """Returns actions, [K, B, N, A], of observations as recorded; `network`: a slow copy."""
        outputs = (network or self.network)(self.inputs(observations))
        actions = outputs.tanh() if self.squash else outputs
        return actions.view(*observations.shape[:3], -1)

    def transitions(self, batch: Batch) -> Batch:
        """Returns the batch, whose rows are the transitions to learn from."""
        return batch

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns a batch of transitions, and the actions there, [K, B, N, A]."""
        return batch, self(batch.observations)


class DelayedActor(Descent):
    """Policies of K seeds that end in tanh, their slow copies for targets, and their optimizer."""

    def __init__(
        self, online: StackedActor, n_seeds: int, *, learning_rate: float, max_norm: float | None
    ) -> None:
        self.online = online  # the policies that are trained
        super().__init__(
            {"actor": online.network}, n_seeds, learning_rate, max_norm, followed=("actor",)
        )
        self.target = self.targets["actor"]  # parameters of their slow copies

    def __call__(self, observations: Tensor) -> Tensor:
        """Returns actions, [K, B, N, A], of observations [K, B, N, O] as recorded."""
        return self.online(observations)

    def smoothed(
        self, noise: Tensor, observations: Tensor, deviation: float, largest: float
    ) -> Tensor:
        """Returns the slow copies' actions with clipped noise, [K, B, N, A], in [-1, 1].

        Target policy smoothing (Fujimoto et al. 2018, eq. 14): standard normal `noise` [K, B, N, A]
        times `deviation`, clipped to [-largest, largest]; observations as recorded, [K, B, N, O].
        """
        actions = self.online(observations, self.target)
        return (actions + (noise * deviation).clamp(-largest, largest)).clamp(-1, 1)


DENSITY_STREAM = 5
"""Stream of a seed's initial parameters, beside those of actors, critics and mixers."""

LOG_STD_RANGE = (-3.0, 1.0)
"""Of the network's output."""


class BehaviorDensity(Descent):
    """beta(a_i | o_i) = N(tanh m(o_i, i), s(o_i, i)^2), with a deviation that depends on both.

    It sees what the actors see, by a network of the same kind. Where the data's robots act alike, s
    is small and leaving the data costs much. `floor` is the least deviation: without one, a certain
    density forbids every improvement.
    """

    def __init__(
        self,
        actor: StackedActor,
        seeds: Sequence[int],
        *,
        floor: float,
        learning_rate: float,
        max_norm: float | None,
    ) -> None:
        self._actor, self._floor = actor, floor
        network = actor.network
        shape: Any = replace(network.shape, outputs=2 * network.shape.outputs)
        self.network = type(network)(shape, len(network.flat), network.flat.device)
        initialize(self.network, seeds, DENSITY_STREAM)
        super().__init__({"density": self.network}, len(seeds), learning_rate, max_norm)

    def gradient(
        self, observations: Tensor, actions: Tensor, alive: Tensor | None = None
    ) -> Tensor:
        """Fills the gradient; returns the negative log-likelihood, the mean over rows, [K].

        Each row is weighted by its own variance: by likelihood alone, the mean would learn little
        where the deviation is large (beta-NLL with beta = 1; Seitzer et al. 2022, "On the pitfalls
        of heteroscedastic uncertainty estimation with probabilistic neural networks"). Observations
        [K, B, N, O] are as recorded, actions [K, B, N, A] the data's; `alive` is as in `presence`.
        """
        mean, log_std = self._outputs(self.network(self._actor.inputs(observations)), actions)
        losses = 0.5 * ((actions - mean) / log_std.exp()).square() + log_std  # [K, B, N, A]
        weighted = agent_mean((losses * (2 * log_std.detach()).exp()).sum(3), alive)  # [K]
        self.network.backward(weighted.sum())
        return agent_mean(losses.detach().sum(3), alive)

    @torch.no_grad()
    def moments(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and deviation, at least the floor, both shaped as actions, [K, B, N, A].

        Observations are as recorded, [K, B, N, O].
        """
        outputs = self.network(self._actor.inputs(observations))
        mean, log_std = self._outputs(outputs, actions)
        return mean, log_std.exp().clamp(min=self._floor)

    @staticmethod
    def _outputs(outputs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = outputs.chunk(2, -1)
        log_std = log_std.clamp(*LOG_STD_RANGE)
        return mean.tanh().view(actions.shape), log_std.view(actions.shape)
