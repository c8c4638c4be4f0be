"""Behavior cloning given a latent of the episode: teams that act by the convention of one episode.

Data of several teams, each with a convention of its own, have modes that hold for whole episodes.
Observations tell robots too late, or never, which one the others follow. So every recorded episode
e has a latent w_e, a few numbers that are learned with the actors, as in generative latent
optimization (Bojanowski et al. 2018, "Optimizing the Latent Space of Generative Networks"):

    min_{mu, w}  E_{e, (o, a) ~ e}  1/(N A) sum_i |mu(o_i, i, w_e) - a_i|^2  +  c/D |w_e|^2

In every episode that it plays, the team takes the latent of one recorded episode, which a seed that
its robots agreed on chooses. It then follows that episode's convention, and follows each convention
as often as the data do; of a mixture, as the episodes of all parts do, whatever their weights. What
varies within an episode is averaged, as in `bc`.

Deviations: latents are held small by a penalty, the paper's lie in a ball; the loss is a squared
error; new latents are those of recorded episodes, not draws from a normal fitted to them.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import cloning_loss
from swarmdata.learn.policies.drawn_policy import LatentPolicy
from swarmdata.learn.training.actor_critic import OfflineLearner
from swarmdata.learn.training.settings import LogUniform, Space
from swarmdata.offline_algos.bc import CLONING_SPACE, CloningConfig
from swarmdata.types import Batch

LATENT_STREAM = 5
"""Of a seed's initial latents, beside those of `networks.actor`."""


@dataclass(frozen=True)
class BCLatentConfig(CloningConfig):
    """Cloning with a latent for each recorded episode; one setting for all datasets."""

    latent_size: int = 2  # D
    latent_weight: float = 1e-3  # c
    latent_learning_rate: float = 3e-2  # each latent is in few batches


class BCLatent(OfflineLearner):
    """K actors with the latents of M episodes each, trained at once."""

    Config = BCLatentConfig
    FIELDS = ("observations", "actions", "episodes")
    LOSSES = ("bc_loss", "latent_size")
    SPACE: ClassVar[Space] = {
        **CLONING_SPACE,
        "latent_learning_rate": LogUniform(3e-3, 0.3),
        "latent_weight": LogUniform(1e-4, 1e-2),
    }

    def __init__(self, setup: Setup, config: BCLatentConfig) -> None:
        self.config, sizes = config, setup.sizes
        if setup.n_episodes < 1:
            raise SchemaError(
                f"bc_latent got {setup.n_episodes} episodes, expected their number: each has a "
                "latent. Give it as Setup.n_episodes."
            )
        n_inputs = sizes.observation + config.latent_size + sizes.n_agents
        self.actor = StackedMLP(
            MLPShape(n_inputs, config.hidden, sizes.action), setup.n_seeds, setup.device
        )
        # one linear layer of the episode's one-hot number: its weight is the table of latents
        self.table = StackedMLP(
            MLPShape(setup.n_episodes, (), config.latent_size), setup.n_seeds, setup.device
        )
        initialize(self.actor, setup.seeds, ACTOR_STREAM)
        initialize(self.table, setup.seeds, LATENT_STREAM)
        self.descent = Descent(
            {"actor": self.actor, "latents": self.table}, setup.n_seeds,
            {"actor": config.learning_rate, "latents": config.latent_learning_rate},
            config.max_grad_norm,
        )  # fmt: skip
        self.parts = (self.descent,)
        self.frame, self.standard = sizes.frame, Standardization.of(setup.statistics, setup.device)

    def latents(self) -> Tensor:
        """Returns w, the latents of all episodes, [K, M, D]."""
        (layer,) = self.table.layers
        return layer.weight + layer.bias

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns the imitation error and mean |w|^2 / D, [K]."""
        config = self.config
        if batch.episodes is None:
            raise SchemaError("bc_latent got a batch without `episodes`, expected a dataset's")
        rows = batch.episodes[..., None].expand(-1, -1, config.latent_size)
        w = self.latents().gather(1, rows)  # [K, B, D]
        bc_loss = cloning_loss(self._act(batch.observations, w), batch.actions, batch.alive)
        size = w.square().mean((1, 2))
        self.descent.step(bc_loss + config.latent_weight * size, self.scale)
        self.n_updates += 1
        return {"bc_loss": bc_loss.detach(), "latent_size": size.detach()}

    def _act(self, observations: Tensor, w: Tensor) -> Tensor:
        """Returns mu, [K, B, N, A], of observations [K, B, N, O] and latents [K, B, D]."""
        o = self.standard(observations)
        team = w[:, :, None].expand(-1, -1, o.shape[2], -1)
        outputs = self.actor(with_agent_id(torch.cat([o, team], 3)).flatten(1, 2))
        return outputs.tanh().view(*o.shape[:3], -1)

    def policy(self, index: int) -> LatentPolicy:
        return LatentPolicy(
            layers=self.actor.extract(index, torch.float64),
            latents=self.latents()[index].detach().to("cpu", torch.float64),
            observation_mean=self.standard.mean,
            observation_std=self.standard.std,
            frame=self.frame,
        )
