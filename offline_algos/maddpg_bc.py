"""MADDPG+BC: a centralized critic improves actors that stay close to the dataset's actions.

The algorithm is TD3+BC (Fujimoto & Gu 2021, eq. 3-5) with the critic of MADDPG (Lowe et al. 2017,
eq. 6), which sees x = (state, all observations) and all actions; with two critics it is
MATD3 (Ackermann et al. 2019, section 4). With team reward r, the mean over agents:

    y      = r + gamma (1 - termination) min_j Q'_j(x', pi'(o') + clip(noise, -c, c))
    L(Q_j) = (Q_j(x, a) - y)^2                                              every update
    L(pi)  = -lambda Q_1(x, pi(o)) + sum_i 1/A |pi(o_i, i) - a_i|^2         every `policy_delay`-th
    lambda = alpha / max(mean |Q_1(x, pi(o))|, 1), detached

Deviations:
- Actors are one network for all agents, which sees the agent's number.
- `joint_gradient` "all": Q sees every agent's action from its policy (the centralized gradient of
  FACMAC, Peng et al. 2021, eq. 7). "own" is MADDPG's eq. 6: agent i's action from its policy and
  the others' from the data, which can fail to coordinate (Tilbury et al. 2024, arXiv 2407.01343).
- mean |Q_1| is taken as at least 1, which is one standard deviation of the returns-to-go: team
  returns cross 0, where the paper's lambda explodes (measured: 17 instead of 2.5, and policies that
  push through obstacles).
- The imitation error is summed over agents and averaged over action components, so that an agent
  is held to the data as strongly in a team as alone.
- The critics have LayerNorm. Observations and states are normalized with the dataset's statistics,
  rewards are divided by the standard deviation of the returns-to-go.
- `clip_target`: y uses min(Q', R*), with R* the largest discounted return-to-go of the dataset (the
  critic clipping of B3C, Kim et al. 2026, with a tighter bound).
- Warm-up: in the first `bc_warmup_updates` lambda is 0 and actors move in every update, so
  that they clone the data while critics are still noise.
- Learning rates decay along a cosine, as that of behavior cloning does.
- The critics' learning rate is 1e-3; the paper's 3e-4 is for a million updates and does not decay.
  That of the actors is the one of `bc`, which has measured it.
- The discount is 0.95 per control step, not the paper's 0.99: rewards for progress and contact are
  dense, so that 20 steps (2 s) hold the consequences of an action. Its effect was not isolated.
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.compilation import compilable
from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.objectives.in_sample import team_cloning_loss
from swarmdata.learn.objectives.td_targets import td_error, td_target, team_reward
from swarmdata.learn.training.actor_critic import (
    DelayedConfig,
    joint_parts,
    policy_of,
    restore_state,
    state_of,
)
from swarmdata.learn.training.exploration import normal_like
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGBCConfig(DelayedConfig):
    """TD3+BC with a centralized critic; one setting for all datasets."""

    rl_weight: float = 2.5  # alpha; Fujimoto & Gu 2021, table 3
    joint_gradient: JointGradient = "all"
    clip_target: bool = True


class MADDPGBC:
    """K seeds of actors and two critics, trained at once."""

    Config = MADDPGBCConfig
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda")

    policy, state_dict, load_state_dict = policy_of, state_of, restore_state

    def __init__(self, setup: Setup, config: MADDPGBCConfig) -> None:
        self.config, self.n_updates = config, 0
        self.actor, self.critics, self.generators, self.normalizer = joint_parts(
            setup, config, clip_target=config.clip_target
        )

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves.

        The loop is `delayed_update`, with gradients that can be compiled.
        """
        config = self.config
        scale = cosine(self.n_updates, config.n_updates, config.final_learning_rate_factor)
        noise = normal_like(self.generators, batch.actions)
        x = self.normalizer.information(batch.states, batch.observations)
        losses = self.critic_gradient(batch, x, noise)
        self.critics.optimizer.descend(scale)
        self.n_updates += 1
        is_warmup = self.n_updates <= config.bc_warmup_updates
        if is_warmup or self.n_updates % config.policy_delay == 0:
            losses |= self.actor_gradient(batch, x, 0.0 if is_warmup else config.rl_weight)
            self.actor.optimizer.descend(scale)
            self.actor.follow(config.tau)
            self.critics.follow(config.tau)
        return losses

    @compilable
    def critic_gradient(self, batch: Batch, x: Tensor, noise: Tensor) -> dict[str, Tensor]:
        """Fills the critics' gradients with that of sum_j L(Q_j); returns losses, each [K]."""
        y = self.targets(batch, noise)  # [K, B]
        q = self.critics.q(x, batch.actions)[..., 0]  # [K, 2, B]
        critic_loss = td_error(q, y)  # [K]
        self.critics.online.backward(critic_loss.sum())
        return {"critic_loss": critic_loss.detach(), "q": q.detach().mean((1, 2))}

    @torch.no_grad()
    def targets(self, batch: Batch, noise: Tensor) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards.

        Args:
            batch: tensors [K, B, ...].
            noise: standard normal, [K, B, N, A], of the target policies' smoothing.
        """
        o_next, config = batch.next_observations, self.config
        a_next = self.actor.smoothed_by(noise, o_next, config.smoothing, config.smoothing_clip)
        x_next = self.normalizer.information(batch.next_states, o_next)
        q_next = self.critics.target_q(x_next, a_next)[..., 0].amin(1)  # [K, B], the smaller one
        q_next = q_next.clamp(max=self.normalizer.max_value)
        r = team_reward(batch.rewards) * self.normalizer.reward_scale
        return td_target(r, batch.terminations, q_next, config.discount)

    @torch.no_grad()
    def td_error(self, batch: Batch) -> Tensor:
        """Returns the mean of (Q_j - y)^2, [K], over critics and rows; y without noise."""
        y = self.targets(batch, torch.zeros_like(batch.actions))  # [K, B]
        x = self.normalizer.information(batch.states, batch.observations)
        q = self.critics.q(x, batch.actions)  # [K, 2, B, 1]
        return (q[..., 0] - y[:, None]).square().mean((1, 2))

    @compilable
    def actor_gradient(self, batch: Batch, x: Tensor, rl_weight: float) -> dict[str, Tensor]:
        """Fills the actors' gradients with that of L(pi); returns losses, each [K].

        Args:
            batch: tensors [K, B, ...].
            x: what the critics see, [K, B, S + N O].
            rl_weight: alpha; 0 clones the data.
        """
        pi = self.actor(batch.observations)  # [K, B, N, A]
        bc_loss = team_cloning_loss(pi, batch.actions)  # [K]
        losses = {"bc_loss": bc_loss}
        actor_loss = bc_loss
        if rl_weight != 0:
            # [K, B], or [K, B N] for "own"; the critics' parameters are constants here
            q = self.critics.policy_values(x, pi, batch.actions, self.config.joint_gradient)[..., 0]
            lam = rl_weight / q.detach().abs().mean(1).clamp(min=1.0)  # [K]
            actor_loss = bc_loss - lam * q.mean(1)
            losses |= {"policy_q": q.mean(1), "lambda": lam}
        self.actor.online.network.backward(actor_loss.sum())
        return {name: loss.detach() for name, loss in losses.items()}
