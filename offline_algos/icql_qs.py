"""ICQL-QS: in targets and penalties, one robot alone leaves the data.

Partial action replacement ("Partial action replacement: tackling distribution shift in offline
MARL", 2025, arXiv 2511.07629; its variant that replaces one agent) with the counterfactual penalty
of CFCQL (Shao et al. 2023, eq. 5 and 6). A joint action in which all agents leave the data is far
from it; one in which a single robot i does is as near as in a problem with one robot. So in the
target of robot i's value only i's next action comes from the policy:

    y_i    = r_i + gamma (1 - termination) min_j Q'_ji(x', (pi'(o'_i) + clip(noise, -c, c), a'_-i))

a' are the data's next actions; all else is of `cfcql`, the same algorithm with the policy's joint
action in the targets.

Deviations:
- Where the horizon cut an episode nobody acted next, so there is no a': all agents of that row take
  the policy's actions, as in MADDPG. Where the task ended, nothing is bootstrapped. The next row of
  the file, another episode's, is never used (the code of CFCQL takes it, `utils/buffer.py`).
- No code is published. The paper draws one robot for each row of the one value that all share; here
  each robot has a value, of which it is the one that leaves the data. The paper's weighted sum over
  several numbers of replaced agents (SPaCQL) is left out.
- All others of `cfcql`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.offline_algos.cfcql import CFCQL, CFCQLConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class ICQLQSConfig(CFCQLConfig):
    """Partial action replacement with counterfactual CQL, whose settings it has."""


class ICQLQS(CFCQL):
    """K seeds of actors and two critics whose targets let one agent leave the data."""

    Config = ICQLQSConfig
    FIELDS = (*CFCQL.FIELDS, "next_actions", "truncations")

    def next_actions(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Returns a robot's next action in its own value, and the others' in it, [K, B, N, A]."""
        if batch.next_actions is None:
            raise SchemaError(
                "a batch for icql_qs has no next_actions, expected those of the data; take batches "
                "from the sampler of a dataset"
            )
        pi_next = self.smoothed_actions(batch)
        # nobody acted after a cut: there everybody's action comes from the policy
        is_cut = batch.truncations[..., None, None]
        return pi_next, torch.where(is_cut, pi_next, batch.next_actions)
