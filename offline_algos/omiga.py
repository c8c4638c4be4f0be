"""OMIGA: a global regularization of the team becomes a local one of every agent, in the data only.

Wang, Xu, Zheng & Zhan, "Offline multi-agent reinforcement learning with implicit global-to-local
value regularization", NeurIPS 2023. Names are those of the authors' code (`algos/OMIGA.py`,
functions in brackets), from which the losses were read. With x = (state, all observations) and team
reward r, the mean over agents:

    Q(o, a) = sum_i w_i(x) Q_i(o_i, a_i) + b(x),  V(o) = sum_i w_i(x) V_i(o_i) + b(x),  w_i >= 0
    L(Q, w, b) = (r + gamma (1 - termination) V'(o') - Q(o, a))^2                  [q_loss]
    z_i        = w'_i(x) (Q'_i(o_i, a_i) - V_i(o_i)) / alpha
    L(V_i)     = exp(z_i) + w'_i(x) V_i(o_i) / alpha                               [v_loss]
    L(pi)      = E_{r ~ w} 1/A |pi(o_i, i) - a_i|^2,  w_r = exp(beta z_i)          [policy_loss]

E_{r ~ w} is the mean over rows r, of one robot at one step, which are drawn in proportion to their
weights; beta is 1, or as much less as keeps `effective_share` of the rows effective
(`objectives.weighted_rows`). Primes are slow copies, which are constants in V_i's and the policy's
losses. V_i is the soft maximum over the data's actions: L(V_i) is least where the mean of exp(z_i)
is 1.

Deviations:
- alpha is in units of scaled rewards, divided by the standard deviation of the returns-to-go; the
  paper's 10 is for rewards as the simulators give them. Far below the default, z has a deviation
  above 1, and policies follow the errors of the values.
- In L(V_i), exp(z) goes on as its tangent above exp(z) = w*. The code cuts z at 10 instead, which
  leaves such samples no gradient but that of + w V / alpha: it lowers a V that is too low already.
- In L(pi), the code has weights as factors, exp(10) = 22,026 at most, and beta 1. As factors of at
  most w* they were in the published studies.
- w_i = |1 + h_i(x)| / N rather than |h_i(x)|: `mixers.LinearMixer` says why.
- Actors are deterministic and cloned with a weighted squared error, as in `iql`; the paper's are
  Gaussians under a tanh.
- x has the state; in the code it is the observations. LayerNorm, normalization, cosines and the
  discount are those of `maddpg_bc`.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.learn.networks.factored_critics import VALUE_STREAM, FactoredCritics
from swarmdata.learn.networks.mixers import LinearMixer
from swarmdata.learn.networks.network_inputs import Normalizer, RobotRewards, information
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP
from swarmdata.learn.networks.presence import acting, agent_mean, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.objectives.losses import cloning_loss, soft_value_loss, td_target, team_reward
from swarmdata.learn.objectives.weighted_rows import ScoredRows
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.policies.trained import actor_policy
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    TRANSITION,
    ActorCriticConfig,
    OfflineLearner,
    squashed_actor,
)
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class OMIGAConfig(ActorCriticConfig):
    """Implicit global-to-local regularization; one setting for all datasets."""

    mixer_hidden: int = 64  # of the network of w and b, as in the authors' code
    temperature: float = 0.1  # alpha; see the deviations above
    max_weight: float = 100.0  # w*, of values
    effective_share: float = 0.3  # of the rows, see `objectives.weighted_rows`


class OMIGA(OfflineLearner):
    """K seeds of actors, factored critics and local value networks, trained at once."""

    Config = OMIGAConfig
    FIELDS = TRANSITION
    LOSSES = ("critic_loss", "value_loss", "actor_loss", "q", "exponent_std", "inverse_temperature")
    SPACE: ClassVar[Space] = {
        **ACTOR_CRITIC_SPACE,
        "temperature": LogUniform(0.01, 10.0),
        "effective_share": Choice((0.3, 0.5, 0.7)),
    }

    def __init__(self, setup: Setup, config: OMIGAConfig) -> None:
        self.config, self.generators = config, setup.generators()
        self.rows = ScoredRows(config.effective_share, self.generators)
        sizes, norm = setup.sizes, config.max_grad_norm
        self.actor = squashed_actor(setup, config)
        self.mixer = LinearMixer(setup, config.mixer_hidden)
        self.critics = FactoredCritics(
            setup, config.critic_hidden, self.mixer,
            learning_rate=config.critic_learning_rate, max_norm=norm, n_critics=1,
        )  # fmt: skip
        shape = MLPShape(sizes.observation, config.critic_hidden, 1, layer_norm=True)
        self.values = Team(
            shape, sizes.n_agents, setup.seeds, VALUE_STREAM,
            parameters="shared", device=setup.device,
        )  # fmt: skip
        self.descent = Descent(
            {"actor": self.actor.network, "values": self.values.network}, setup.n_seeds,
            {"actor": config.actor_learning_rate, "values": config.critic_learning_rate}, norm,
            followed=("values",), moments={"values": "value_adam"},
        )  # fmt: skip
        self.target_values: StackedMLP = self.descent.targets["values"]
        self.normalizer = Normalizer(setup.statistics, setup.device)
        self.rewards = RobotRewards(setup.statistics, "team")
        self.parts = (self.descent, self.critics, self.rows)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses, each [K]."""
        config = self.config
        scale = self.scale
        s, o = self.normalizer(batch.states, batch.observations)
        y = self.targets(batch)
        value_loss, z = self.value_loss(s, o, batch.actions, batch.alive)  # [K], [K, B, N]
        q = self.critics.q(s, o, batch.actions, batch.alive)[:, 0]  # [K, B]
        critic_loss = (q - y).square().mean(1)  # [K]
        self.rows.add(batch, z.detach(), batch.alive)
        actions, pi, beta = self.rows.draw(self.actor.along, 1.0)
        actor_loss = cloning_loss(pi, actions)
        self.critics.step(critic_loss, scale)
        self.descent.step_of("values", value_loss, scale)
        self.descent.step_of("actor", actor_loss, scale)
        self.critics.follow(config.tau)
        self.descent.follow(config.tau)
        self.n_updates += 1
        losses = (critic_loss, value_loss, actor_loss, q.mean(1), z.std((1, 2)), beta)
        return {name: loss.detach() for name, loss in zip(self.LOSSES, losses, strict=True)}

    def value_loss(
        self, s: Tensor, o: Tensor, actions: Tensor, alive: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Returns L(V_i), [K], and z_i, [K, B, N], of the data's actions, [K, B, N, A].

        States and observations, [K, B, S] and [K, B, N, O], are normalized.
        """
        with torch.no_grad():
            q = self.critics.agent_values(o, actions, self.critics.target_utilities)[:, 0]
            w, _ = self.mixer.weights(information(s, o), self.critics.target_mixer)  # [K, B, N]
        v = w * self.values(o)[..., 0] / self.config.temperature  # [K, B, N]
        z = w * q / self.config.temperature - v
        return agent_mean(soft_value_loss(z, v, self.config.max_weight), alive), z

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y of `q_loss`, [K, B], in units of scaled rewards."""
        s_next, o_next = self.normalizer(batch.next_states, batch.next_observations)
        values = self.values(o_next, self.target_values)[..., 0]  # [K, B, N]
        values = acting(values[..., None], going_on(batch))[..., 0]
        v_next = self.mixer(values, information(s_next, o_next), self.critics.target_mixer)
        r = team_reward(batch.rewards) * self.rewards.scale
        return td_target(r, batch.terminations, v_next, self.config.discount)

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        return actor_policy(self.actor, index)
