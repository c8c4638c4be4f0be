"""OneStepActor: each robot maps its own observation and noise to an action, in one step."""

from typing import NamedTuple

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.policies.flow_policy import (
    FlowPolicy,
    Noise,
    Redraw,
    known_noise,
    noise_size,
)
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


class StudentView(NamedTuple):
    """Transitions, and what one-step actors see of them besides noise."""

    batch: Batch  # fields [K, B, ...]
    features: Tensor  # normalized observations, with the memory if there is one, [K, B, N, F]


class OneStepActor:
    """Students of a `JointFlow`: mu(o_i, i, z) of K seeds, shared by all agents.

    Args:
        setup: sizes, seeds, the moments of observations, and where the parameters are.
        hidden: sizes of the hidden layers.
        noise: what a robot knows of the team's noise, see `FlowPolicy`.
        redraw: when it is drawn anew in an episode; training is the same for both.
        scale: of the noise when policies act; in training it is 1.
    """

    def __init__(
        self,
        setup: Setup,
        hidden: tuple[int, ...],
        *,
        noise: Noise,
        redraw: Redraw,
        scale: float,
    ) -> None:
        sizes, statistics = setup.sizes, setup.statistics
        self.sizes, self.noise, self.redraw, self.scale = sizes, noise, redraw, scale
        n_inputs = sizes.observation + noise_size(noise, sizes.n_agents, sizes.action)
        shape = MLPShape(n_inputs + sizes.n_agents, hidden, sizes.action)
        self.network = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        mean, std = statistics.observation_mean, statistics.observation_std
        self._standard = Standardization(mean, std, setup.device)

    def see(self, batch: Batch) -> StudentView:
        """Returns transitions [K, B, ...], and what the actors see of them."""
        return StudentView(batch, self._standard(batch.observations))

    def see_next(self, view: StudentView) -> Tensor:
        """Returns what the actors see one step later, [K, B, N, O]."""
        return self._standard(view.batch.next_observations)

    def __call__(self, features: Tensor, noise: Tensor) -> Tensor:
        """Returns actions, [K, B, N, A], in (-1, 1).

        Args:
            features: what the actors see, [K, B, N, O].
            noise: z of the whole team, standard normal, [K, B, N, A].
        """
        known = torch.cat([features, known_noise(noise, self.noise)], -1)
        outputs = self.network(with_agent_id(known).flatten(1, 2))
        return outputs.tanh().view_as(noise)

    def policy(self, index: int) -> FlowPolicy:
        """Returns the policy of seed number `index`, a copy of its parameters as they are now."""
        return FlowPolicy(
            layers=self.network.extract(index, torch.float64),
            observation_mean=self._standard.mean,
            observation_std=self._standard.std,
            n_agents=self.sizes.n_agents,
            noise=self.noise,
            redraw=self.redraw,
            noise_scale=self.scale,
            frame=self.sizes.frame,
        )
