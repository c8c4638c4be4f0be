"""MADDPG+CQL: a centralized critic that is pessimistic about joint actions the data lack.

CQL (Kumar et al. 2020, eq. 4, the form CQL(H) with importance sampling of appendix F) on the two
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
- Actors are one network for all agents, which sees the agent's number. Warm-up, target
  smoothing, LayerNorm, `clip_target`, normalization and learning rates are those of `maddpg_bc`,
  which has their sources.
- `bc_weight` w: the papers have none; it is 0.4 for the reason that `cfcql` gives.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.objectives.conservative import (
    Samples,
    cql_gap,
    join_samples,
    noisy_samples,
    uniform_samples,
)
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
class MADDPGCQLConfig(DelayedConfig):
    """CQL over joint actions; `cql_weight` and `temperature` are those of `cfcql`."""

    cql_weight: float = 0.5  # alpha, of the penalty; as `cfcql`
    temperature: float = 0.1  # of the soft maximum, tau in the penalty
    n_samples: int = 5  # of each of the three kinds; 10 in the papers' code
    sample_noise: float = 0.2  # the code of OMAR and CFCQL
    joint_gradient: JointGradient = "all"
    bc_weight: float = 0.4  # w; as `cfcql`
    clip_target: bool = True


class MADDPGCQL:
    """K seeds of actors and two critics with penalties on joint actions, trained at once."""

    Config = MADDPGCQLConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    critic_inputs, bc_loss = joint_inputs, staticmethod(team_cloning_loss)

    def __init__(self, setup: Setup, config: MADDPGCQLConfig) -> None:
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
        """Returns gap_j, [K, 2]; draws joint actions.

        Args:
            batch: tensors [K, B, ...].
            x: what the critics see, [K, B, S + N O].
            q: their values of the data's actions, [K, 2, B].
        """
        samples = self.samples(batch)
        values = self.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B, 3 M]
        return cql_gap(samples, values, q, self.config.temperature)

    @torch.no_grad()
    def samples(self, batch: Batch) -> Samples:
        """Returns joint actions from anywhere, near pi(o) and near pi(o'), [K, B, 3 M, N, A]."""
        n_samples, deviation = self.config.n_samples, self.config.sample_noise
        near = [
            noisy_samples(self.generators, self.actor(o), n_samples, deviation)
            for o in (batch.observations, batch.next_observations)
        ]
        return join_samples([uniform_samples(self.generators, batch.actions, n_samples), *near])

    def actor_loss(self, batch: Batch, x: Tensor, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns L(pi); the critics' parameters are constants here."""
        # [K, B], or [K, B N] for "own"
        q = self.critics.policy_values(x, pi, batch.actions, self.config.joint_gradient)[..., 0]
        size = q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        return Loss(self.config.bc_weight * bc_loss - q.mean(1) / size, {"policy_q": q.mean(1)})
