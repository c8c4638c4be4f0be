"""BehaviorDensity: a Gaussian density of the data's actions, for K seeds at once."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import StackedActor
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.training.checkpoint import part

DENSITY_STREAM = 5
"""Stream of a seed's initial parameters, beside those of actors, critics and mixers."""

LOG_STD_RANGE = (-3.0, 1.0)
"""Of the network's output."""


class BehaviorDensity:
    """beta(a_i | o_i) = N(tanh m(o_i, i), s(o_i, i)^2), with a deviation that depends on both.

    It sees what the actors see. Where the data's robots act alike, s is small and leaving the data
    costs much; where they differ, it costs little. An error of equal weight everywhere, as in
    TD3+BC, knows no difference.

    Args:
        actor: whose inputs the density shares.
        seeds: of the initial parameters, [K].
        hidden: sizes of the hidden layers.
        floor: least deviation; without one, a certain density forbids every improvement.
        learning_rate: of Adam.
        max_norm: largest norm of one seed's gradient; None does not clip.
    """

    def __init__(
        self,
        actor: StackedActor,
        seeds: Sequence[int],
        hidden: tuple[int, ...],
        *,
        floor: float,
        learning_rate: float,
        max_norm: float | None,
    ) -> None:
        self._actor, self._floor = actor, floor
        inputs, actions = actor.network.shape.inputs, actor.network.shape.outputs
        shape = MLPShape(inputs, hidden, 2 * actions)
        self.network = StackedMLP(shape, len(seeds), actor.network.flat.device)
        initialize(self.network, seeds, DENSITY_STREAM)
        self.optimizer = StackedAdam(self.network, len(seeds), learning_rate, max_norm)

    def gradient(self, observations: Tensor, actions: Tensor) -> Tensor:
        """Fills the gradient; returns the negative log-likelihood, the mean over rows, [K].

        The mean descends the squared error and the deviation the likelihood: by likelihood alone,
        the mean would learn little where the deviation is large (Seitzer et al. 2022, "On the
        pitfalls of heteroscedastic uncertainty estimation with probabilistic neural networks",
        whose loss with beta = 1 this is for the mean).

        Args:
            observations: as recorded, [K, B, N, O].
            actions: of the data, [K, B, N, A].
        """
        mean, log_std = self._outputs(self.network(self._actor.inputs(observations)), actions)
        squares = (actions - mean).square()
        scaled = 0.5 * squares.detach() * (-2 * log_std).exp() + log_std  # of the deviation
        loss: Tensor = (0.5 * squares + scaled).sum(3).mean((1, 2))
        self.network.backward(loss.sum())
        return scaled.detach().sum(3).mean((1, 2))

    @torch.no_grad()
    def moments(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and deviation, at least the floor, of each action, both [K, B, N, A].

        Args:
            observations: as recorded, [K, B, N, O].
            actions: of the right shape, [K, B, N, A].
        """
        outputs = self.network.frozen(self._actor.inputs(observations))
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
