"""ICQL-QS: in targets and penalties, one robot alone leaves the data.

Partial action replacement ("Partial action replacement: tackling distribution shift in offline
MARL", 2025, arXiv 2511.07629; its variant that replaces one agent) with the counterfactual penalty
of CFCQL (Shao et al. 2023, eq. 5 and 6). A joint action in which all agents leave the data is far
from it; one in which a single robot i does is as near as in a problem with one robot. So in the
target of robot i's value only i's next action comes from the policy:

    y_i    = r_i + gamma (1 - termination) min_j Q'_ji(x', (pi'(o'_i) + clip(noise, -c, c), a'_-i))
    gap_j  = mean_i [tau log integral exp(Q_ji(x, (b, a_-i)) / tau) db - Q_ji(x, a)]
    L(Q_j) = mean_i (Q_ji(x, a) - y_i)^2 + alpha gap_j                      every update
    L(pi)  = mean_i -Q_1i(x, (pi(o_i), a_-i)) / q + w 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

a' are the data's next actions; Q_ji, r_i and x are those of `cfcql`, which is the same algorithm
with the policy's joint action in the targets.

Its settings are those of `cfcql`, which has measured the penalty; this one was not measured alone.

Deviations:
- Where the horizon cut an episode nobody acted next, so there is no a': all agents of that row take
  the policy's actions, as in MADDPG. Where the task ended, nothing is bootstrapped. The next row of
  the file, another episode's, is never used (the code of CFCQL takes it, `utils/buffer.py`).
- No code is published. The paper draws one robot for each row of the one value that all share; here
  each robot has a value, of which it is the one that leaves the data. The paper's weighted sum over
  several numbers of replaced agents (SPaCQL), with weights from the spread of an ensemble of ten
  critics, is left out.
- The penalty's deviations, the units of alpha and tau, and all else are those of `cfcql`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.extraction.second_stage import EXTRACTION_LOSSES
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
    penalized_critic_loss,
    robot_actor_loss,
    robot_inputs,
    robot_parts,
    robot_valuer,
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
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q", *EXTRACTION_LOSSES)

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    valuer = robot_valuer
    critic_inputs, bc_loss, actor_loss = robot_inputs, staticmethod(cloning_loss), robot_actor_loss
    critic_loss = penalized_critic_loss

    def __init__(self, setup: Setup, config: ICQLQSConfig) -> None:
        self.config, self.n_updates = config, 0
        self.actor, self.critics, self.rewards = robot_parts(setup, config, "centralized")
        self.generators = setup.generators()
        self.second_stage = second_stage(setup, config, self.actor, self.generators)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y_i, [K, B, N], in units of scaled rewards; draws the smoothing noise.

        Raises:
            SchemaError: the batch does not know the next actions.
        """
        if batch.next_actions is None:
            raise SchemaError(
                "a batch for icql_qs has no next_actions, expected those of the data; take batches "
                "from the sampler of a dataset"
            )
        pi_next = smoothed_actions(self, batch.next_observations)
        # nobody acted after a cut: there everybody's action comes from the policy
        is_cut = batch.truncations[..., None, None]
        others = torch.where(is_cut, pi_next, batch.next_actions)  # [K, B, N, A]
        x_next = self.critics.view(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, pi_next, others).amin(1)  # [K, B, N], the smaller
        q_next = q_next.clamp(max=self.rewards.max_value)
        ends = batch.terminations[..., None]
        return td_target(self.rewards(batch.rewards), ends, q_next, self.config.discount)

    def gap(self, batch: Batch, x: RobotView, q: Tensor) -> Tensor:
        """Returns gap_j, [K, 2], given Q_ji(x, a), [K, 2, B, N]; draws the robots' actions."""
        return counterfactual_gap(self.critics, self.generators, self.config, x, batch.actions, q)
