"""MADDPG+CQL: a centralized critic that is pessimistic about joint actions the data lack.

CQL (Kumar et al. 2020, eq. 4, the form CQL(H) with importance sampling of appendix F) on the twin
joint critics of MATD3 (Lowe et al. 2017, eq. 6; Ackermann et al. 2019, section 4); MACQL in the
tables of Shao et al. 2023. Joint actions b_m are drawn evenly, near pi(o), and near pi(o'), M of
each, from densities p_m:

    y      = r + gamma (1 - termination) min_j Q'_j(x', pi'(o') + clip(noise, -c, c))
    gap_j  = tau log 1/3M sum_m exp(Q_j(x, b_m) / tau) / p_m - Q_j(x, a)
    L(Q_j) = (Q_j(x, a) - y)^2 + alpha gap_j                                every update
    L(pi)  = -Q_1(x, pi(o)) / q + w sum_i 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

x is the state and all observations, r the mean reward over agents. It is here to be compared with:
the space of joint actions grows with the number of agents, and so does what is penalized (Shao et
al. 2023, section 3.1); `cfcql` does not have that.

Deviations:
- The three kinds of samples are one mixture, as in the authors' code; each has the density of its
  own kind, that of noise before actions are clipped to [-1, 1].
- The policies are deterministic; samples near them have Gaussian noise (`sample_noise`), as in the
  code of OMAR and CFCQL, with its log-density (OMAR's subtracts the density itself).
- No Lagrange multiplier: alpha is fixed, and in units of scaled rewards, as is tau; `cfcql` says
  why tau is below 1.
- Actors are one network for all agents, which sees the agent's number. Warm start, target
  smoothing, LayerNorm, `clip_target`, normalization and step sizes are those of `maddpg_bc`, which
  has their sources.
- `bc_weight` w: the papers have none; it is 0.4 for the reason that `cfcql` gives.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.objectives.conservative import (
    Samples,
    noisy_samples,
    soft_maximum,
    together,
    uniform_samples,
)
from swarmdata.learn.objectives.pessimistic import PessimisticConfig, PessimisticTeam
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGCQLConfig(PessimisticConfig):
    """CQL over joint actions; alpha and tau are `cfcql`'s, and were not tuned apart."""

    n_samples: int = 5  # of each of the three kinds; 10 in the papers' code
    sample_noise: float = 0.2  # the code of OMAR and CFCQL
    joint_gradient: JointGradient = "all"


class MADDPGCQL(PessimisticTeam):
    """K seeds of actors and twin critics with penalties on joint actions, trained at once."""

    Config = MADDPGCQLConfig

    def gap(self, batch: Batch, x: Tensor, q: Tensor) -> Tensor:
        """Draws joint actions; see `PessimisticTeam.gap`."""
        samples = self._samples(batch)
        values = self.parts.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B, 3 M]
        highest = soft_maximum(values, samples.log_density, self.config.temperature)
        return (highest - q).mean(2)

    @torch.no_grad()
    def _samples(self, batch: Batch) -> Samples:
        """Joint actions from anywhere, from near pi(o) and from near pi(o'), [K, B, 3 M, N, A]."""
        noise, config, actor = self.parts.generators, self.config, self.parts.actor
        near = [
            noisy_samples(noise, actor(observations), config.n_samples, config.sample_noise)
            for observations in (batch.observations, batch.next_observations)
        ]
        return together([uniform_samples(noise, batch.actions, config.n_samples), *near])
