"""Distillation: a joint flow of the data, and the one-step actors that copy it."""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.learn.flows.joint_flow import JointFlow
from swarmdata.learn.flows.one_step_actor import FlowSettings, OneStepActor
from swarmdata.learn.networks.network_inputs import normal_like, uniform_like
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.setup import Setup


class Distillation:
    """Flows and actors of K seeds, with an optimizer each.

    Args:
        setup: sizes, seeds and the moments of observations.
        config: of the flow, and of what the actors know of noise and of the past.
        hidden: sizes of the actors' hidden layers.
        learning_rate: of the actors.
    """

    def __init__(
        self, setup: Setup, config: FlowSettings, hidden: tuple[int, ...], *, learning_rate: float
    ) -> None:
        self.flow = JointFlow(
            setup.sizes, setup.seeds, config.flow_hidden, config.n_flow_steps, setup.device
        )
        self.actor = OneStepActor(setup, config, hidden)
        self._descent = Descent(
            {"flow": self.flow.network, "actor": self.actor.network}, setup.n_seeds,
            {"flow": config.flow_learning_rate, "actor": learning_rate}, config.max_grad_norm,
        )  # fmt: skip
        self.state_dict = self._descent.state_dict
        self.load_state_dict = self._descent.load_state_dict

    def fit(
        self, x: Tensor, actions: Tensor, generators: Sequence[torch.Generator], scale: float
    ) -> Tensor:
        """Moves the flow one step towards the data; returns its loss, [K].

        Args:
            x: normalized states and observations, [K, B, S + N O].
            actions: joint actions of the data, [K, B, N, A].
            generators: of noise and times, one per seed, [K].
            scale: factor on the learning rate.
        """
        times = uniform_like(generators, actions[:, :, 0, :1])  # [K, B, 1]
        loss = self.flow.loss(x, actions, normal_like(generators, actions), times)
        self._descent.step_of("flow", loss, scale)
        return loss

    def step(self, loss: Tensor, scale: float) -> None:
        """Moves the actors down the sum over seeds of a loss [K]; `scale` is of their rate."""
        self._descent.step_of("actor", loss, scale)
