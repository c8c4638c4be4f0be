"""Distillation: a joint flow of the data, and the one-step actors that copy it.

A student that copies samples F(c, z) alone copies the flow's errors and adds its own; where the
data are of experts, that is most of its distance to a clone of the same size. So the targets are
debiased: with the data's action a in the same row and independent noise z',

    T = F(c, z) + a - F(c, z')

Given c and z, the mean of T is F(c, z) plus what the mean of the flow lacks of that of the data. So
students spread as the flow does, about the mean of the data. The price is noise in the targets,
twice the spread of the data, and where the flow weighs modes otherwise than the data do, all of
them move by the difference of the means.
"""

from collections.abc import Mapping, Sequence
from typing import Any

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
        self._debiased = config.debiased
        self._descent = Descent(
            {"teacher": self.flow.network, "actor": self.actor.network}, setup.n_seeds,
            {"teacher": config.flow_learning_rate, "actor": learning_rate}, config.max_grad_norm,
        )  # fmt: skip
        self.state_dict = self._descent.state_dict

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
        self._descent.step_of("teacher", loss, scale)
        return loss

    def targets(
        self, x: Tensor, z: Tensor, actions: Tensor, generators: Sequence[torch.Generator]
    ) -> Tensor:
        """Returns what the actors copy, T, without a gradient, [K, B, N, A]; draws the noise z'.

        Args:
            x: normalized states and observations, [K, B, S + N O].
            z: the noise that the actors see, [K, B, N, A].
            actions: joint actions of the data, [K, B, N, A].
            generators: of the noise z', one per seed, [K].
        """
        samples = self.flow.sample(x, z)
        if not self._debiased:
            return samples
        return samples + actions - self.flow.sample(x, normal_like(generators, actions))

    def step(self, loss: Tensor, scale: float) -> None:
        """Moves the actors down the sum over seeds of a loss [K]; `scale` is of their rate."""
        self._descent.step_of("actor", loss, scale)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone.

        Checkpoints of swarmdata 0.2 have another kind of flow, under another name. Their actors are
        read, for policies; their runs do not go on, since their settings lack `debiased`.
        """
        blank = {} if "teacher" in state else self.state_dict()
        kept = {name: tensor for name, tensor in blank.items() if name.startswith("teacher")}
        self._descent.load_state_dict({**kept, **state})
