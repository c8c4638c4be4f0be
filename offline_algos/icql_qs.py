"""ICQL-QS: in targets and penalties, one agent alone leaves the data.

Partial action replacement ("Partial action replacement: tackling distribution shift in offline
MARL", 2025, arXiv 2511.07629; its variant that replaces one agent) with the counterfactual penalty
of CFCQL (Shao et al. 2023, eq. 5 and 6). A joint action in which all agents leave the data is far
from it; one in which a single agent i does is as near as in a problem with one agent. So i is drawn
evenly, and only i's next action comes from the policy:

    y      = r + gamma (1 - termination) min_j Q'_j(x', (pi'(o'_i) + clip(noise, -c, c), a'_-i))
    gap_j  = sum_i lambda_i [tau log integral exp(Q_j(x, (b, a_-i)) / tau) db - Q_j(x, a)]
    L(Q_j) = (Q_j(x, a) - y)^2 + alpha gap_j                                every update
    L(pi)  = -Q_1(x, (pi(o_i), a_-i)) / q + w sum_i 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

x is the state and all observations, r the mean reward over agents, a' the data's next actions.

Deviations:
- Where the horizon cut an episode nobody acted next, so there is no a': all agents of that row take
  the policy's actions, as in MADDPG. Where the task ended, nothing is bootstrapped. The next row of
  the file, another episode's, is never used (the code of CFCQL takes it, `utils/buffer.py`).
- No code is published. The paper's weighted sum over several numbers of replaced agents (SPaCQL),
  with weights from the spread of an ensemble of ten critics, is left out.
- lambda_i = 1/N, with one agent drawn for each row; the penalty's other deviations, and the units
  of alpha and tau, are those of `cfcql`.
- Actors, warm-up, target smoothing, LayerNorm, `clip_target`, normalization and learning rates are
  those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none; it is 0.4 for the reason that `cfcql` gives.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.objectives.conservative import (
    counterfactual_gap,
    draw_agents,
    replace_drawn,
)
from swarmdata.learn.objectives.in_sample import team_cloning_loss
from swarmdata.learn.objectives.td_targets import td_error, td_target, team_reward
from swarmdata.learn.training.actor_critic import (
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
from swarmdata.offline_algos.cfcql import CFCQLConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class ICQLQSConfig(CFCQLConfig):
    """Partial action replacement with counterfactual CQL, whose settings it has."""


class ICQLQS:
    """K seeds of actors and two critics whose targets let one agent leave the data."""

    Config = ICQLQSConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    critic_inputs, bc_loss = joint_inputs, staticmethod(team_cloning_loss)

    def __init__(self, setup: Setup, config: ICQLQSConfig) -> None:
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
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise and the agents.

        Raises:
            SchemaError: the batch does not know the next actions.
        """
        if batch.next_actions is None:
            raise SchemaError(
                "a batch for icql_qs has no next_actions, expected those of the data; take batches "
                "from the sampler of a dataset"
            )
        pi_next = smoothed_actions(self, batch.next_observations)
        agents = draw_agents(self.generators, batch.actions)  # [K, B, N]
        # nobody acted after a cut: there everybody's action comes from the policy
        agents = agents | batch.truncations[..., None]
        a_next = replace_drawn(batch.next_actions, pi_next, agents)  # [K, B, N, A]
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
