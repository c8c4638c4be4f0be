"""CFCQL: critics pessimistic about each agent that alone leaves the data; others' actions stay.

Shao et al., "Counterfactual conservative Q-learning for offline multi-agent reinforcement
learning", NeurIPS 2023. Kumar et al.'s penalty (CQL, 2020) on joint actions grows with the number
of agents; here agent i's action b is sampled, and the others' are those of the data (eq. 5 and 6):

    y      = r + gamma (1 - termination) min_j Q'_j(x', pi'(o') + clip(noise, -c, c))
    gap_j  = sum_i lambda_i [tau log integral exp(Q_j(x, (b, a_-i)) / tau) db - Q_j(x, a)]
    L(Q_j) = (Q_j(x, a) - y)^2 + alpha gap_j                                every update
    L(pi)  = -Q_1(x, (pi(o_i), a_-i)) / q + w sum_i 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

x is the state and all observations, r the mean reward over agents.

Deviations:
- lambda_i = 1/N, the paper's uniform weights; its weights by the distance from the data need a
  model of the data's actions. With 1/N the sum is a mean over agents, so one agent is drawn for
  each row: the same penalty in expectation, at 1/N of the critic evaluations.
- Sampled actions are uniform, as in the authors' code for particle worlds.
- alpha and tau are in units of scaled rewards, of which the returns-to-go have deviation 1, and one
  pair serves all datasets. The authors choose alpha for each (0.3 to 5) in raw rewards, whose
  values are tens of times as large, with tau 1: that is a tau of a few hundredths here.
- The authors make 5 critic steps for one of the actors; here it is `policy_delay` 2, after a
  warm-up in which the critics learn the value of a clone, as in MADDPG+BC.
- Actors are one network for all agents, which sees the agent's number. Target smoothing, LayerNorm,
  `clip_target`, normalization and learning rates are those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none. With w = 0 actors leave narrow data: on `coop_nav-expert-mini`
  (2 seeds, 1,500 updates of 128 rows, hidden sizes 64, 100 episodes) the score was -141. 0.4 is the
  weight that MADDPG+BC at alpha 2.5 has.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.objectives.conservative import counterfactual_gap
from swarmdata.learn.objectives.in_sample import team_cloning_loss
from swarmdata.learn.objectives.td_targets import td_error, td_target, team_reward
from swarmdata.learn.training.actor_critic import (
    DelayedConfig,
    Loss,
    delayed_update,
    joint_inputs,
    joint_parts,
    policy_of,
    restore_state,
    smoothed_actions,
    state_of,
)
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class CFCQLConfig(DelayedConfig):
    """Counterfactual CQL: 10 samples and the gradient of one's own action, as the paper's code."""

    cql_weight: float = 0.5  # alpha, of the penalty; see the deviations above, also for tau
    temperature: float = 0.1  # of the soft maximum, tau in the penalty
    n_samples: int = 10  # of the drawn agent's actions, for each row's penalty
    joint_gradient: JointGradient = "own"
    bc_weight: float = 0.4  # w; see the deviations above
    clip_target: bool = True


class CFCQL:
    """K seeds of actors and two critics with counterfactual penalties, trained at once."""

    Config = CFCQLConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    critic_inputs, bc_loss = joint_inputs, staticmethod(team_cloning_loss)

    def __init__(self, setup: Setup, config: CFCQLConfig) -> None:
        self.config, self.n_updates, self.second_stage = config, 0, None
        self.actor, self.critics, self.generators, self.normalizer = joint_parts(
            setup, config, clip_target=config.clip_target
        )

    def critic_loss(self, batch: Batch, x: Tensor) -> Loss:
        """Returns sum_j L(Q_j); draws the targets' noise and the penalty's actions."""
        y = self.targets(batch)  # without a gradient
        q = self.critics.q(x, batch.actions)[..., 0]  # [K, 2, B]
        td_loss = td_error(q, y)  # [K]
        gap = self.gap(batch, x, q).sum(1)  # [K]
        reported = {"critic_loss": td_loss, "gap": gap, "q": q.mean((1, 2))}
        return Loss(td_loss + self.config.cql_weight * gap, reported)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        a_next = smoothed_actions(self, batch.next_observations)
        x_next = self.normalizer.information(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, a_next)[..., 0].amin(1)  # [K, B], the smaller one
        q_next = q_next.clamp(max=self.normalizer.max_value)
        r = team_reward(batch.rewards) * self.normalizer.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def gap(self, batch: Batch, x: Tensor, q: Tensor) -> Tensor:
        """Returns gap_j, [K, 2]; draws an agent for each row, and its actions."""
        return counterfactual_gap(self.critics, self.generators, self.config, x, batch.actions, q)

    def actor_loss(self, batch: Batch, x: Tensor, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns L(pi); the critics' parameters are constants here."""
        # [K, B], or [K, B N] for "own"
        q = self.critics.policy_values(x, pi, batch.actions, self.config.joint_gradient)[..., 0]
        size = q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        return Loss(self.config.bc_weight * bc_loss - q.mean(1) / size, {"policy_q": q.mean(1)})
