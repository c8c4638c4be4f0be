"""BehaviorDensity: a Gaussian density of the data's actions, for K seeds at once."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import StackedActor
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import StackedMLP, initialize
from swarmdata.learn.networks.set_networks import StackedSets
from swarmdata.learn.training.checkpoint import part

DENSITY_STREAM = 5
"""Stream of a seed's initial parameters, beside those of actors, critics and mixers."""

LOG_STD_RANGE = (-3.0, 1.0)
"""Of the network's output."""


class BehaviorDensity:
    """beta(a_i | o_i) = N(tanh m(o_i, i), s(o_i, i)^2), with a deviation that depends on both.

    It sees what the actors see, by a network of the same kind. Where the data's robots act alike,
    s is small and leaving the data costs much; where they differ, it costs little. An error of equal weight everywhere, as in
    TD3+BC, knows no difference.

    Args:
        actor: whose inputs and kind of network the density shares.
        seeds: of the initial parameters, [K].
        floor: least deviation; without one, a certain density forbids every improvement.
        learning_rate: of Adam.
        max_norm: largest norm of one seed's gradient; None does not clip.
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
        self.network = _doubled(actor.network)
        initialize(self.network, seeds, DENSITY_STREAM)
        self.optimizer = StackedAdam(self.network, len(seeds), learning_rate, max_norm)

    def gradient(self, observations: Tensor, actions: Tensor) -> Tensor:
        """Fills the gradient; returns the negative log-likelihood, the mean over rows, [K].

        Each row is weighted by its own variance: by likelihood alone, the mean would learn little
        where the deviation is large (beta-NLL with beta = 1; Seitzer et al. 2022, "On the pitfalls
        of heteroscedastic uncertainty estimation with probabilistic neural networks").

        Args:
            observations: as recorded, [K, B, N, O].
            actions: of the data, [K, B, N, A].
        """
        mean, log_std = self._outputs(self.network(self._actor.inputs(observations)), actions)
        losses = 0.5 * ((actions - mean) / log_std.exp()).square() + log_std  # [K, B, N, A]
        weighted = (losses * (2 * log_std.detach()).exp()).sum(3).mean((1, 2))  # [K]
        self.network.backward(weighted.sum())
        return losses.detach().sum(3).mean((1, 2))

    @torch.no_grad()
    def moments(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and deviation, at least the floor, of each action, both [K, B, N, A].

        Args:
            observations: as recorded, [K, B, N, O].
            actions: of the right shape, [K, B, N, A].
        """
        outputs = self.network(self._actor.inputs(observations))
        mean, log_std = self._outputs(outputs, actions)
        return mean, log_std.exp().clamp(min=self._floor)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters and Adam's moments, as copies."""
        adam = {f"density_adam.{k}": v for k, v in self.optimizer.state_dict().items()}
        return {"density": self.network.flat.clone(), **adam}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self.network.load(state["density"])
        self.optimizer.load_state_dict(part(state, "density_adam"))

    @staticmethod
    def _outputs(outputs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = outputs.chunk(2, -1)
        log_std = log_std.clamp(*LOG_STD_RANGE)
        return mean.tanh().view(actions.shape), log_std.view(actions.shape)


def _doubled(network: StackedMLP | StackedSets) -> StackedMLP | StackedSets:
    """Makes networks of the same kind and sizes with twice as many outputs."""
    n_outputs, n_networks = 2 * network.shape.outputs, len(network.flat)
    device = network.flat.device
    if isinstance(network, StackedSets):
        return StackedSets(replace(network.shape, outputs=n_outputs), n_networks, device)
    return StackedMLP(replace(network.shape, outputs=n_outputs), n_networks, device)
