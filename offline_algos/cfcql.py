"""CFCQL: critics pessimistic about each robot that alone leaves the data; others' actions stay.

Shao et al., "Counterfactual conservative Q-learning for offline multi-agent reinforcement
learning", NeurIPS 2023. Kumar et al.'s penalty (CQL, 2020) on joint actions grows with the number
of agents; here agent i's action b is sampled, and the others' are those of the data (eq. 5 and 6):

    y_i    = r_i + gamma (1 - termination) min_j Q'_ji(x', pi'(o') + clip(noise, -c, c))
    gap_j  = mean_i [tau log integral exp(Q_ji(x, (b, a_-i)) / tau) db - Q_ji(x, a)]
    L(Q_j) = mean_i (Q_ji(x, a) - y_i)^2 + alpha gap_j                      every update
    L(pi)  = mean_i -Q_1i(x, (pi(o_i), a_-i)) / q + w 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

Q_ji is the value of robot i's own rewards r_i (`reward: team`: the mean over robots), from what
`robot_views` calls a centralized view of it, here x. Without the penalty (alpha 0) it is MADDPG
with an imitation term.

On `coop_nav-medium-replay`, whose data score 24.4 and whose clone `bc` 22.3, it scored 39.5 [35.9,
43.7] and without the penalty 41.8 [36.4, 45.3] (4,500 updates of 128 rows, 64 units, 5 seeds, 1,000
validation episodes; `cards/studies/validation`): the penalty does not change the score, but what it
is made of. With it, robots collide 0.45 times an episode with each other and 3.2 times with
obstacles, without it 0.82 and 4.8 times, and 43 instead of 68 % of the episodes are solved. One
value of the team's mean reward and w 0.4, summed over robots, gave a clone: 23.7, without the
penalty 22.4 (3,000 updates, 3 seeds, 256 episodes).

Deviations:
- The paper has one value of a reward that all agents share. Of rewards that are each robot's own, a
  mean over the team hides what one robot's action did (`robot_rewards`).
- lambda_i = 1/N, the paper's uniform weights; its weights by the distance from the data need a
  model of the data's actions.
- Sampled actions are uniform, as in the authors' code for particle worlds.
- alpha and tau are in units of scaled rewards, of which the returns-to-go have deviation 1, and one
  pair serves all datasets. The authors choose alpha for each (0.3 to 5) in raw rewards, whose
  values are tens of times as large, with tau 1: that is a tau of a few hundredths here.
- `gap_limit`: the penalty ends where it has done its work; `conservative.cql_gap` says why.
- The authors make 5 critic steps for one of the actors; here it is `policy_delay` 2, after a
  warm-up in which the critics learn the value of a clone, as in MADDPG+BC.
- Actors are one network for all agents, which sees the agent's number. Target smoothing, LayerNorm,
  `clip_target`, normalization and learning rates are those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.extraction.second_stage import EXTRACTION_LOSSES
from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.networks.robot_views import RobotView
from swarmdata.learn.objectives.conservative import counterfactual_gap
from swarmdata.learn.objectives.in_sample import cloning_loss
from swarmdata.learn.objectives.td_targets import td_target
from swarmdata.learn.training.actor_critic import (
    delayed_update,
    policy_of,
    restore_state,
    second_stage,
    smoothed_actions,
    state_of,
)
from swarmdata.learn.training.robot_actor_critic import (
    ConservativeConfig,
    penalized_critic_loss,
    robot_actor_loss,
    robot_inputs,
    robot_parts,
    robot_valuer,
)
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class CFCQLConfig(ConservativeConfig):
    """Counterfactual CQL: the gradient of one's own action, as in the paper's code."""

    n_samples: int = 5  # of each robot's actions; 10 in the paper's code, at twice the cost
    joint_gradient: JointGradient = "own"


class CFCQL:
    """K seeds of actors and two critics with counterfactual penalties, trained at once."""

    Config = CFCQLConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q", *EXTRACTION_LOSSES)

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    valuer = robot_valuer
    critic_inputs, bc_loss, actor_loss = robot_inputs, staticmethod(cloning_loss), robot_actor_loss
    critic_loss = penalized_critic_loss

    def __init__(self, setup: Setup, config: CFCQLConfig) -> None:
        self.config, self.n_updates = config, 0
        self.actor, self.critics, self.rewards = robot_parts(setup, config, "centralized")
        self.generators = setup.generators()
        self.second_stage = second_stage(setup, config, self.actor, self.generators)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y_i, [K, B, N], in units of scaled rewards; draws the smoothing noise."""
        a_next = smoothed_actions(self, batch.next_observations)
        x_next = self.critics.view(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, a_next).amin(1)  # [K, B, N], the smaller one
        q_next = q_next.clamp(max=self.rewards.max_value)
        ends = batch.terminations[..., None]
        return td_target(self.rewards(batch.rewards), ends, q_next, self.config.discount)

    def gap(self, batch: Batch, x: RobotView, q: Tensor) -> Tensor:
        """Returns gap_j, [K, 2], given Q_ji(x, a), [K, 2, B, N]; draws the robots' actions."""
        return counterfactual_gap(self.critics, self.generators, self.config, x, batch.actions, q)
