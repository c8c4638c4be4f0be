"""OMIGA: a global regularization of the team becomes a local one of every agent, in the data only.

Wang, Xu, Zheng & Zhan, "Offline multi-agent reinforcement learning with implicit global-to-local
value regularization", NeurIPS 2023. Names are those of the authors' code (`algos/OMIGA.py`,
functions in brackets), from which the losses were read. With x = (state, all observations) and team
reward r, the mean over agents:

    Q(o, a) = sum_i w_i(x) Q_i(o_i, a_i) + b(x),  V(o) = sum_i w_i(x) V_i(o_i) + b(x),  w_i >= 0
    L(Q, w, b) = (r + gamma (1 - termination) V'(o') - Q(o, a))^2                  [q_loss]
    z_i        = w'_i(x) (Q'_i(o_i, a_i) - V_i(o_i)) / alpha
    L(V_i)     = exp(z_i) + w'_i(x) V_i(o_i) / alpha                               [v_loss]
    L(pi)      = min(exp(z_i), w*) 1/A |pi(o_i, i) - a_i|^2, mean over i           [policy_loss]

Primes are slow copies, which are constants in V_i's and the policy's losses. V_i is the soft
maximum over the data's actions: L(V_i) is least where the mean of exp(z_i) is 1.

Deviations:
- alpha is in units of scaled rewards, divided by the standard deviation of the returns-to-go; the
  paper's 10 is for rewards as the simulators give them. It was chosen on version 0 of `coop_nav`:
  with 0.02, z has a deviation above 1, and policies follow the errors of the values.
- In L(V_i), exp(z) goes on as its tangent above exp(z) = w*. The code cuts z at 10 instead, which
  leaves such samples no gradient but that of + w V / alpha: it lowers a V that is too low already.
  The subtraction of the largest z, which the cut makes necessary, is not needed then.
- In L(pi), exp(z) is at most w*, 100 as in implicit Q-learning; in the code exp(10) = 22,026.
- w_i = |1 + h_i(x)| / N rather than |h_i(x)|: `mixers.LinearMixer` says why.
- Actors are deterministic and cloned with a weighted squared error, as in `iql`; the paper's are
  Gaussians under a tanh.
- Utilities and V_i have LayerNorm, and all see normalized inputs. x has the state; in the code it
  is the observations.
- Learning rates decay along a cosine; the discount is 0.95, for the reason that `maddpg_bc` gives.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.factored_critics import MIXER_STREAM, VALUE_STREAM, FactoredCritics
from swarmdata.learn.networks.mixers import LinearMixer
from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.optimizer import StackedAdam, cosine
from swarmdata.learn.networks.perceptrons import MLPShape
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.objectives.in_sample import (
    exponential_weights,
    soft_value_loss,
    weighted_cloning_loss,
)
from swarmdata.learn.objectives.td_targets import move_target, td_target, team_reward
from swarmdata.learn.training.actor_critic import ActorCriticConfig, policy_of, squashed_actor
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class OMIGAConfig(ActorCriticConfig):
    """Implicit global-to-local regularization; one setting for all datasets."""

    mixer_hidden: int = 64  # of the network of w and b, as in the authors' code
    temperature: float = 0.1  # alpha; see the deviations above
    max_weight: float = 100.0  # w*


class OMIGA:
    """K seeds of actors, factored critics and local value networks, trained at once."""

    Config = OMIGAConfig
    LOSSES = ("critic_loss", "value_loss", "actor_loss", "q", "exponent_std", "weight")

    policy = policy_of

    def __init__(self, setup: Setup, config: OMIGAConfig) -> None:
        self.config, self.n_updates = config, 0
        sizes, seeds, norm = setup.sizes, setup.seeds, config.max_grad_norm
        self.actor = squashed_actor(setup, config)
        self.mixer = LinearMixer(
            sizes.n_agents, sizes.information, seeds, MIXER_STREAM,
            hidden=config.mixer_hidden, device=setup.device,
        )  # fmt: skip
        self.critics = FactoredCritics(
            sizes, seeds, config.critic_hidden, self.mixer,
            learning_rate=config.critic_learning_rate, max_norm=norm, n_critics=1,
            device=setup.device,
        )  # fmt: skip
        shape = MLPShape(sizes.observation, config.critic_hidden, 1, layer_norm=True)
        self.values = Team(
            shape, sizes.n_agents, seeds, VALUE_STREAM, parameters="shared", device=setup.device
        )
        self.target_values = self.values.network.clone()
        self.actor_adam = StackedAdam(
            self.actor.network, setup.n_seeds, config.actor_learning_rate, norm
        )
        self.value_adam = StackedAdam(
            self.values.network, setup.n_seeds, config.critic_learning_rate, norm
        )
        self.normalizer = Normalizer(setup.statistics, setup.device)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses, each [K]."""
        config = self.config
        scale = cosine(self.n_updates, config.n_updates, config.final_learning_rate_factor)
        s = self.normalizer.states(batch.states)
        o = self.normalizer.observations(batch.observations)
        y = self.targets(batch)
        value_loss, z = self.value_loss(s, o, batch.actions)  # [K], [K, B, N]
        q = self.critics.q(s, o, batch.actions)[:, 0]  # [K, B]
        critic_loss = (q - y).square().mean(1)  # [K]
        weights = exponential_weights(z, config.max_weight)  # [K, B, N]
        pi = self.actor(batch.observations)  # [K, B, N, A]
        actor_loss = weighted_cloning_loss(pi, batch.actions, weights)
        self.critics.step(critic_loss, scale)
        self.value_adam.step(value_loss, scale)
        self.actor_adam.step(actor_loss, scale)
        self.critics.follow(config.tau)
        move_target(self.target_values, self.values.network, config.tau)
        self.n_updates += 1
        losses = (critic_loss, value_loss, actor_loss, q.mean(1))
        spread = (z.std((1, 2)), weights.mean((1, 2)))
        named = zip(self.LOSSES, (*losses, *spread), strict=True)
        return {name: loss.detach() for name, loss in named}

    def value_loss(self, s: Tensor, o: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Returns L(V_i), [K], and z_i, [K, B, N].

        Args:
            s: normalized states, [K, B, S].
            o: normalized observations, [K, B, N, O].
            actions: of the data, [K, B, N, A].
        """
        with torch.no_grad():
            q = self.critics.agent_values(o, actions, self.critics.target_utilities)[:, 0]
            w, _ = self.mixer.weights(information(s, o), self.critics.target_mixer)  # [K, B, N]
        v = w * self.values(o)[..., 0] / self.config.temperature  # [K, B, N]
        z = w * q / self.config.temperature - v
        return soft_value_loss(z, v, self.config.max_weight).mean((1, 2)), z

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y of `q_loss`, [K, B], in units of scaled rewards."""
        s_next = self.normalizer.states(batch.next_states)
        o_next = self.normalizer.observations(batch.next_observations)
        values = self.values(o_next, self.target_values)[..., 0]  # [K, B, N]
        v_next = self.mixer(values, information(s_next, o_next), self.critics.target_mixer)
        r = team_reward(batch.rewards) * self.normalizer.reward_scale
        return td_target(r, batch.terminations, v_next, self.config.discount)

    def state_dict(self) -> dict[str, Any]:
        """Parameters, targets, Adam's moments and the number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "actor": self.actor.network.flat.clone(),
            "values": self.values.network.flat.clone(),
            "target_values": self.target_values.flat.clone(),
            **{f"actor_adam.{k}": v for k, v in self.actor_adam.state_dict().items()},
            **{f"value_adam.{k}": v for k, v in self.value_adam.state_dict().items()},
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        self.actor.network.load(state["actor"])
        self.values.network.load(state["values"])
        self.target_values.load(state["target_values"])
        self.actor_adam.load_state_dict(part(state, "actor_adam"))
        self.value_adam.load_state_dict(part(state, "value_adam"))
        self.critics.load_state_dict(state)
