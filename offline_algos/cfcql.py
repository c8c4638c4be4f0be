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
- The authors make 5 critic steps for one of the actors; here it is `policy_delay` 2, after a warm
  start in which the critics learn the value of a clone, as in MADDPG+BC.
- Actors are one network for all agents, which sees the agent's number. Target smoothing, LayerNorm,
  `clip_target`, normalization and step sizes are those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none. With w = 0 actors leave narrow data: on `coop_nav-expert-mini`
  (2 seeds, 1,500 updates of 128 rows, hidden sizes 64, 100 episodes) the score was -141. 0.4 is the
  weight that MADDPG+BC at alpha 2.5 has.
"""

from dataclasses import dataclass

from torch import Tensor

from swarmdata.learn.objectives.conservative import (
    counterfactual_samples,
    draw_agents,
    soft_maximum,
)
from swarmdata.learn.objectives.pessimistic import PessimisticConfig, PessimisticTeam
from swarmdata.types import Batch


@dataclass(frozen=True)
class CFCQLConfig(PessimisticConfig):
    """Counterfactual CQL: 10 samples and the gradient of one's own action, as the paper's code."""


class CFCQL(PessimisticTeam):
    """K seeds of actors and twin critics with counterfactual penalties, trained at once."""

    Config = CFCQLConfig

    def gap(self, batch: Batch, x: Tensor, q: Tensor) -> Tensor:
        """Draws an agent and its actions for each row; see `PessimisticTeam.gap`."""
        noise, config = self.parts.generators, self.config
        agents = draw_agents(noise, batch.actions)
        samples = counterfactual_samples(noise, batch.actions, agents, config.n_samples)
        values = self.parts.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B, M]
        highest = soft_maximum(values, samples.log_density, config.temperature)
        return (highest - q).mean(2)
