"""MADDPG+CQL: centralized critics that are pessimistic about joint actions the data lack.

CQL (Kumar et al. 2020, eq. 4, the form CQL(H) with importance sampling of appendix F) on the two
critics of MATD3 (Lowe et al. 2017, eq. 6; Ackermann et al. 2019, section 4); MACQL in the tables of
Shao et al. 2023. Joint actions b_m are drawn evenly, near pi(o), and near pi(o'), M of each, from
densities p_m:

    gap_j  = mean_i [tau log 1/3M sum_m exp(Q_ji(x, b_m) / tau) / p_m - Q_ji(x, a)]
    L(pi)  = mean_i -Q_1i(x, pi(o)) / q + w 1/A |pi(o_i, i) - a_i|^2

All else is that of `cfcql`. The space of joint actions grows with the number of agents, and so does
what is penalized (Shao et al. 2023, section 3.1); `cfcql` does not have that.

Deviations:
- The three kinds of samples are one mixture, as in the authors' code; each has the density of its
  own kind, that of noise before actions are clipped to [-1, 1].
- The policies are deterministic; samples near them have Gaussian noise (`sample_noise`), as in the
  code of OMAR and CFCQL, with its log-density (OMAR's subtracts the density itself).
- In a frame, pi(o') has the numbers that it has in the frame of o', and is not turned to that of o.
- No Lagrange multiplier: alpha is fixed. All others of `cfcql`.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient, RobotView
from swarmdata.learn.objectives.conservative import (
    Samples,
    join_samples,
    noisy_samples,
    uniform_samples,
)
from swarmdata.offline_algos.cfcql import CFCQL, ConservativeConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGCQLConfig(ConservativeConfig):
    """CQL over joint actions."""

    n_samples: int = 5  # of each of the three kinds; 10 in the papers' code
    sample_noise: float = 0.2  # the code of OMAR and CFCQL
    joint_gradient: JointGradient = "all"


class MADDPGCQL(CFCQL):
    """K seeds of actors and two critics with penalties on joint actions, trained at once."""

    Config = MADDPGCQLConfig
    FIELDS = CFCQL.FIELDS

    def gap(self, batch: Batch, x: RobotView, q: Tensor) -> Tensor:
        """Returns gap_j, [K, 2], given Q_ji(x, a), [K, 2, B, N]; draws joint actions."""
        samples = self.samples(batch)
        values = self.critics.sampled_q(x, samples.actions, samples.actions)  # [K, 2, B, N, 3 M]
        density = samples.log_density[:, :, None].expand_as(values[:, 0])
        return self.mean_gap(density, values, q, self.rewards.learned(batch))

    @torch.no_grad()
    def samples(self, batch: Batch) -> Samples:
        """Returns joint actions from anywhere, near pi(o) and near pi(o'), [K, B, 3 M, N, A]."""
        n_samples, deviation = self.config.n_samples, self.config.sample_noise
        near = [
            noisy_samples(self.generators, self.actor(o), n_samples, deviation)
            for o in (batch.observations, batch.next_observations)
        ]
        return join_samples([uniform_samples(self.generators, batch.actions, n_samples), *near])
