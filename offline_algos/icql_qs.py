"""ICQL-QS: targets in which one agent leaves the data, and critics pessimistic about the same.

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
- Actors, warm start, target smoothing, LayerNorm, `clip_target`, normalization and step sizes are
  those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none; it is 0.4 for the reason that `cfcql` gives.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.objectives.conservative import draw_agents, replace_drawn
from swarmdata.offline_algos.cfcql import CFCQL, CFCQLConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class ICQLQSConfig(CFCQLConfig):
    """Partial action replacement with counterfactual CQL, whose settings it has."""


class ICQLQS(CFCQL):
    """K seeds of `CFCQL`'s actors and critics; only the targets differ."""

    Config = ICQLQSConfig

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the agents and the smoothing noise.

        Raises:
            SchemaError: the batch does not know the next actions.
        """
        if batch.next_actions is None:
            raise SchemaError(
                "a batch for icql_qs has no next_actions, expected those of the data; take batches "
                "from the sampler of a dataset"
            )
        pi = self.parts.next_policy_actions(batch)
        agents = draw_agents(self.parts.generators, batch.actions)  # [K, B, N]
        # nobody acted after a cut: there everybody's action comes from the policy
        agents = agents | batch.truncations[..., None]
        return self.parts.bootstrapped(batch, replace_drawn(batch.next_actions, pi, agents))
