"""Distillation: a joint flow of the data, and the one-step actors that copy it."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from swarmdata.learn.flows.joint_flow import JointFlow
from swarmdata.learn.flows.one_step_actor import OneStepActor
from swarmdata.learn.flows.recurrent_one_step_actor import RecurrentOneStepActor
from swarmdata.learn.networks.optimizer import StackedAdam, restore_networks, state_of_networks
from swarmdata.learn.objectives.in_sample import cloning_loss
from swarmdata.learn.policies.flow_policy import Noise, Redraw
from swarmdata.learn.training.exploration import normal_like, uniform_like
from swarmdata.learn.training.setup import Setup


class FlowConfig(Protocol):
    """Settings of a flow and of the actors that copy it; the last three as `MemorySettings`."""

    @property
    def flow_hidden(self) -> tuple[int, ...]: ...
    @property
    def n_flow_steps(self) -> int: ...
    @property
    def flow_learning_rate(self) -> float: ...
    @property
    def max_grad_norm(self) -> float | None: ...
    @property
    def noise(self) -> Noise: ...
    @property
    def redraw(self) -> Redraw: ...
    @property
    def noise_scale(self) -> float: ...
    @property
    def has_memory(self) -> bool: ...
    @property
    def memory_size(self) -> int: ...
    @property
    def window(self) -> int: ...


class Distillation:
    """Flows and actors of K seeds, with an optimizer each.

    Args:
        setup: sizes, seeds and the moments of observations.
        config: of the flow, and of what the actors know of noise and of the past.
        hidden: sizes of the actors' hidden layers.
        learning_rate: of the actors.
    """

    def __init__(
        self,
        setup: Setup,
        config: FlowConfig,
        hidden: tuple[int, ...],
        *,
        learning_rate: float,
    ) -> None:
        self.flow = JointFlow(
            setup.sizes, setup.seeds, config.flow_hidden, config.n_flow_steps, setup.device
        )
        self.actor = _one_step_actor(setup, config, hidden)
        rates = {
            "flow": (self.flow.network, config.flow_learning_rate),
            "actor": (self.actor.network, learning_rate),
        }
        self._adams = {
            name: StackedAdam(network, setup.n_seeds, rate, config.max_grad_norm)
            for name, (network, rate) in rates.items()
        }

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
        self._adams["flow"].step(loss, scale)
        return loss

    def loss(self, pi: Tensor, x: Tensor, noise: Tensor) -> Tensor:
        """Returns 1/N sum_i 1/A |mu(o_i, z(i)) - F(c, z)_i|^2, the mean over rows, [K].

        Args:
            pi: the actors' actions for some noise, [K, B, N, A].
            x: normalized states and observations, [K, B, S + N O].
            noise: z, the same that the actors got, [K, B, N, A].
        """
        return cloning_loss(pi, self.flow.sample(x, noise))  # samples have no gradient

    def step(self, loss: Tensor, scale: float) -> None:
        """Moves the actors down the sum over seeds of a loss [K]; `scale` is of their rate."""
        self._adams["actor"].step(loss, scale)

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters and Adam's moments, as copies."""
        return state_of_networks(self._adams)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        restore_networks(self._adams, state)


def _one_step_actor(
    setup: Setup, config: FlowConfig, hidden: tuple[int, ...]
) -> OneStepActor | RecurrentOneStepActor:
    """Makes the actors of K seeds, which remember if the settings say so."""
    noise, redraw, scale = config.noise, config.redraw, config.noise_scale
    if config.has_memory:
        return RecurrentOneStepActor(
            setup, hidden, memory_size=config.memory_size, window=config.window,
            noise=noise, redraw=redraw, scale=scale,
        )  # fmt: skip
    return OneStepActor(setup, hidden, noise=noise, redraw=redraw, scale=scale)
