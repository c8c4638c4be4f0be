"""RecurrentOneStepActor: a `OneStepActor` whose robots remember what they observed before.

A robot's memory is that of a gated recurrent unit which sees its normalized observations and its
number, as in `memory.recurrent_actor`; it is empty when an episode begins. Noise does not enter it:
it is new in every step, and what it did is seen in the robot's motion.
"""

import torch
from torch import Tensor

from swarmdata.learn.flows.one_step_actor import StudentView
from swarmdata.learn.memory.gated_networks import N_GATE_LAYERS, GatedShape, StackedGates
from swarmdata.learn.memory.segments import (
    learned_rows,
    learned_steps,
    remembered,
    remembered_next,
    take,
)
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.perceptrons import MLPShape, initialize, mlp
from swarmdata.learn.policies.flow_policy import Noise, Redraw, known_noise, noise_size
from swarmdata.learn.policies.recurrent_flow_policy import RecurrentFlowPolicy
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


class RecurrentOneStepActor:
    """Students of a `JointFlow`: mu(h_i, i, z) of K seeds, with a memory h_i of all of an episode.

    Args:
        setup: sizes, seeds, the moments of observations, and where the parameters are.
        hidden: sizes of the hidden layers.
        memory_size: numbers that a robot remembers, M.
        window: steps of a segment, which the losses are over.
        noise: what a robot knows of the team's noise, see `FlowPolicy`.
        redraw: when it is drawn anew in an episode; training is the same for both.
        scale: of the noise when policies act; in training it is 1.
    """

    def __init__(
        self,
        setup: Setup,
        hidden: tuple[int, ...],
        *,
        memory_size: int,
        window: int,
        noise: Noise,
        redraw: Redraw,
        scale: float,
    ) -> None:
        sizes, statistics = setup.sizes, setup.statistics
        self.sizes, self.window = sizes, window
        self.noise, self.redraw, self.scale = noise, redraw, scale
        n_seen = sizes.observation + sizes.n_agents
        n_inputs = n_seen + memory_size + noise_size(noise, sizes.n_agents, sizes.action)
        reader = MLPShape(n_inputs, hidden, sizes.action)
        shape = GatedShape(n_seen, memory_size, reader)
        self.network = StackedGates(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        mean, std = statistics.observation_mean, statistics.observation_std
        self._standard = Standardization(mean, std, setup.device)

    def see(self, batch: Batch) -> StudentView:
        """Returns the transitions to learn from, and what the actors see of them.

        Args:
            batch: windows [K, B, L, ...]; of the result, rows are B times the steps of a segment.
        """
        rows = learned_rows(batch.mask, self.window)
        features = self._standard(batch.observations)
        memory = take(remembered(self.network, features, batch.mask, "shared"), rows)
        return StudentView(
            learned_steps(batch, rows), torch.cat([take(features, rows), memory], -1)
        )

    @torch.no_grad()
    def see_next(self, view: StudentView) -> Tensor:
        """Returns what the actors see one step later, without a gradient, [K, B, N, O + M]."""
        after = self._standard(view.batch.next_observations)
        memory = view.features[..., self.sizes.observation :]
        return torch.cat([after, remembered_next(self.network, after, memory, "shared")], -1)

    def __call__(self, features: Tensor, noise: Tensor) -> Tensor:
        """Returns actions, [K, B, N, A], in (-1, 1).

        Args:
            features: what the actors see, [K, B, N, O + M].
            noise: z of the whole team, standard normal, [K, B, N, A].
        """
        known = torch.cat([features, known_noise(noise, self.noise)], -1)
        readers = self.network.layers[N_GATE_LAYERS:]
        return mlp(readers, with_agent_id(known).flatten(1, 2)).tanh().view_as(noise)

    def policy(self, index: int) -> RecurrentFlowPolicy:
        """Returns the policy of seed number `index`, a copy of its parameters as they are now."""
        return RecurrentFlowPolicy(
            layers=self.network.extract(index, torch.float64),
            observation_mean=self._standard.mean,
            observation_std=self._standard.std,
            n_agents=self.sizes.n_agents,
            noise=self.noise,
            redraw=self.redraw,
            noise_scale=self.scale,
            frame=self.sizes.frame,
        )
