"""Multi-agent IQL: values of the data's own actions only, then cloning of the better ones.

Implicit Q-learning (Kostrikov, Nair & Levine 2022) of the team as one agent, with the critics of
MADDPG (Lowe et al. 2017, eq. 6), which see x = (state, all observations) and all actions. With team
reward r, the mean over agents, and q = min_j Q'_j(x, a):

    L(V)   = |tau - 1(q < V(x))| (q - V(x))^2                                         eq. 5
    L(Q_j) = (r + gamma (1 - termination) V(x') - Q_j(x, a))^2                        eq. 6
    L(pi)  = min(exp(beta (q - V(x))), w*) 1/N sum_i 1/A |pi(o_i, i) - a_i|^2         eq. 7

No action of a policy ever enters a critic, so nothing outside the data can be overestimated. What
one agent did well and another badly in the same step gets one weight: `omiga` has one per agent.

Deviations:
- Actors are deterministic and one network for all agents, which sees the agent's number. The
  weighted squared error is the paper's weighted log-likelihood for a Gaussian of fixed deviation;
  the paper's Gaussian learns a deviation that does not depend on the state, and acts by its mean.
- Critics and value network have LayerNorm. Inputs are normalized, rewards divided by the standard
  deviation of the returns-to-go. In that unit advantages have a deviation of 0.05 (measured on
  `coop_nav-medium-replay-mini`, after 1,000 updates), so that the paper's beta of 3, for rewards
  scaled to returns of 1,000, weighs almost all alike, between 0.85 and 1.2. More is worse: the
  weights then prefer speed to distance. With 10 the score on `coop_nav-medium-replay` was 6, that
  of `bc` 26 (in the target's frame, 4,000 and 3,000 updates of 128 rows, 2 seeds, 100 episodes).
- The learning rates of all networks decay along a cosine; in the paper only the actor's.
- The discount is 0.95, for the reason that `maddpg_bc` gives.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.recurrent_actor import make_actor
from swarmdata.learn.networks.factored_critics import VALUE_STREAM
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.optimizer import (
    StackedAdam,
    cosine,
    restore_networks,
    state_of_networks,
)
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.objectives.in_sample import (
    expectile_loss,
    exponential_weights,
    weighted_cloning_loss,
)
from swarmdata.learn.objectives.td_targets import td_error, td_target, team_reward
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.actor_critic import (
    ActorCriticConfig,
    joint_critics,
)
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class IQLConfig(MemorySettings, ActorCriticConfig):
    """Implicit Q-learning of a team; one setting for all datasets."""

    expectile: float = 0.7  # tau, Kostrikov et al. 2022, appendix B, for locomotion
    inverse_temperature: float = 3.0  # beta; Kostrikov et al. 2022, appendix B; see above
    max_weight: float = 100.0  # w*, as in the authors' code


class IQL:
    """K seeds of actors, two critics and value networks, trained at once."""

    Config = IQLConfig
    LOSSES = ("value_loss", "critic_loss", "actor_loss", "q", "advantage_std", "weight")

    def __init__(self, setup: Setup, config: IQLConfig) -> None:
        self.config, self.n_updates = config, 0
        self.actor = make_actor(
            setup, config.actor_hidden, config, squash=True, policy_network=config.policy_network
        )
        self.critics = joint_critics(setup, config)
        shape = MLPShape(setup.sizes.information, config.critic_hidden, 1, layer_norm=True)
        self.value = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.value, setup.seeds, VALUE_STREAM)
        self.actor_adam = StackedAdam(
            self.actor.network, setup.n_seeds, config.actor_learning_rate, config.max_grad_norm
        )
        self.value_adam = StackedAdam(
            self.value, setup.n_seeds, config.critic_learning_rate, config.max_grad_norm
        )
        self.normalizer = Normalizer(setup.statistics, setup.device)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...], windows with a memory; returns losses, each [K]."""
        config = self.config
        batch, pi = self.actor.along(batch)  # [K, B, N, A]
        scale = cosine(self.n_updates, config.n_updates, config.final_learning_rate_factor)
        x = self.normalizer.information(batch.states, batch.observations)
        with torch.no_grad():
            q = self.critics.target_q(x, batch.actions)[..., 0].amin(1)  # [K, B]
        advantages = q - self.value(x)[..., 0]
        value_loss = expectile_loss(advantages, config.expectile).mean(1)  # [K], eq. 5
        y = self.targets(batch)  # of the value network as it was
        self.value_adam.step(value_loss, scale)
        critic_loss = td_error(self.critics.q(x, batch.actions)[..., 0], y)  # [K], eq. 6
        self.critics.step(critic_loss, scale)
        # without a gradient, [K, B]
        weights = exponential_weights(config.inverse_temperature * advantages, config.max_weight)
        actor_loss = weighted_cloning_loss(pi, batch.actions, weights[..., None])  # [K], eq. 7
        self.actor_adam.step(actor_loss, scale)
        self.critics.follow(config.tau)
        self.n_updates += 1
        losses = (value_loss, critic_loss, actor_loss, q.mean(1), advantages.std(1))
        named = zip(self.LOSSES, (*losses, weights.mean(1)), strict=True)
        return {name: loss.detach() for name, loss in named}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y of eq. 6, [K, B], in units of scaled rewards."""
        x_next = self.normalizer.information(batch.next_states, batch.next_observations)
        r = team_reward(batch.rewards) * self.normalizer.reward_scale
        v_next = self.value(x_next)[..., 0]  # [K, B]
        return td_target(r, batch.terminations, v_next, self.config.discount)

    def policy(self, index: int) -> TorchPolicy | RecurrentPolicy | SetPolicy:
        """The policy of seed number `index`, as it is now."""
        return self.actor.policy(index)

    def state_dict(self) -> dict[str, Any]:
        """Parameters, targets, Adam's moments and the number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            **state_of_networks({"actor": self.actor_adam, "value": self.value_adam}),
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        restore_networks({"actor": self.actor_adam, "value": self.value_adam}, state)
        self.critics.load_state_dict(state)
