"""Behavior cloning by flow matching: a generative model of joint actions, copied by single robots.

A flow v learns the distribution of the team's joint action given c = (state, all observations),
and one-step actors mu learn to reach its samples F from the same noise z, each from its own
observation (Lipman et al. 2023, flow matching; the distillation is that of Flow Q-learning, Park,
Li & Levine 2025, arXiv 2502.02538, without values):

    L(v)  = E_t (1 - t)^2 |v(c, x_t, t) - (a - z)|^2 / (N A),     x_t = (1 - t) z + t a
    L(mu) = 1/N sum_i 1/A |mu(o_i, z(i)) - T_i|^2,      T = F(c, z) + a - F(c, z')

where z(i) is what robot i knows of the noise and z' is independent of z. A squared error to the
data, as `bc` has, averages the modes of the data; this one averages only what neither o_i nor z(i)
tells. Deviations from Flow Q-learning: the factor (1 - t)^2, which makes L(v) the error of the end
of the path, and T, where the paper has F(c, z). The rest of T takes the flow's error of the mean
out of the students, `learn.flows.one_step_actor`; without `debiased` it is left out.

z is drawn independently of the mode that c already tells: after a few steps the flow reads the mode
from all observations, and a robot that sees less than all can read it neither there nor from z.
`bc_latent` ties its latent to whole episodes.

With `memory` gru the actors remember (`learn.memory`); the flow sees the present of all robots.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from swarmdata.learn.flows.one_step_actor import Distillation, FlowSettings
from swarmdata.learn.networks.network_inputs import Normalizer, information, normal_like
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import cloning_loss
from swarmdata.learn.policies.drawn_policy import FlowPolicy, RecurrentFlowPolicy
from swarmdata.learn.policies.trained import flow_policy
from swarmdata.learn.training.actor_critic import OfflineLearner
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.offline_algos.bc import CLONING_SPACE, CloningConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class BCFlowConfig(FlowSettings, CloningConfig):
    """A joint flow and its students; one setting for all datasets."""


class BCFlow(OfflineLearner):
    """K seeds of joint flows and their students, trained at once."""

    Config = BCFlowConfig
    FIELDS = ("observations", "actions", "states")
    LOSSES = ("flow_loss", "distillation_loss")
    SPACE: ClassVar[Space] = {
        **CLONING_SPACE,
        "flow_learning_rate": LogUniform(3e-4, 1e-2),
        "noise": Choice(("team", "own")),
        "noise_scale": Choice((0.0, 0.5, 1.0)),
    }

    def __init__(self, setup: Setup, config: BCFlowConfig) -> None:
        self.config = config
        self.copy = Distillation(setup, config, config.hidden, learning_rate=config.learning_rate)
        self.parts, self.generators = (self.copy,), setup.generators()
        self.normalizer = Normalizer(setup.statistics, setup.device)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step of both on tensors [K, B, ...], windows with a memory; returns losses, [K]."""
        view, scale = self.copy.actor.see(batch), self.scale
        batch = view.batch
        x = information(*self.normalizer(batch.states, batch.observations))
        flow_loss = self.copy.fit(x, batch, self.generators, scale)
        z = normal_like(self.generators, batch.actions)
        targets = self.copy.targets(x, z, batch, self.generators)
        distillation_loss = cloning_loss(self.copy.actor(view.features, z), targets, batch.alive)
        self.copy.step(distillation_loss, scale)
        self.n_updates += 1
        losses = {"flow_loss": flow_loss, "distillation_loss": distillation_loss}
        return {name: loss.detach() for name, loss in losses.items()}

    def policy(self, index: int) -> FlowPolicy | RecurrentFlowPolicy:
        return flow_policy(self.copy.actor, index)
