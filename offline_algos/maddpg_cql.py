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
- `bc_weight` w: the papers have none; it is 1 for the reason that `cfcql` gives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.conservative import (
    Samples,
    noisy_samples,
    soft_maximum,
    together,
    uniform_samples,
)
from swarmdata.learn.critics import JointGradient
from swarmdata.learn.joint import JointActorCritic, imitation
from swarmdata.learn.optimizer import cosine
from swarmdata.learn.policy import TorchPolicy
from swarmdata.learn.sizes import Sizes
from swarmdata.learn.statistics import Statistics
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGCQLConfig:
    """CQL over joint actions; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 256  # joint transitions
    actor_hidden: tuple[int, ...] = (128, 128)
    critic_hidden: tuple[int, ...] = (128, 128)
    step_size: float = 3e-3  # see `bc`
    critic_step_size: float = 1e-3  # see `maddpg_bc`
    final_step_size: float = 0.0  # factor at the end of the cosine; 1 keeps the step sizes
    discount: float = 0.95
    polyak: float = 0.01  # per actor update
    policy_delay: int = 2
    noise: float = 0.2
    noise_clip: float = 0.5
    alpha: float = 0.5  # of the penalty; not tuned apart from cfcql's; tau the same
    temperature: float = 0.1  # tau
    n_samples: int = 5  # of each of the three kinds; 10 in the papers' code
    sample_noise: float = 0.2  # the code of OMAR and CFCQL
    joint_gradient: JointGradient = "all"
    bc_weight: float = 0.4  # w; see the deviations above
    clip_target: bool = True
    warm_start: int = 4000  # updates in which the actors clone the data
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class MADDPGCQL:
    """K seeds of actors and twin critics, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization, reward scale and R*.
        device: where to train.
    """

    Config = MADDPGCQLConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: MADDPGCQLConfig,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.config, self.n_updates = config, 0
        self.parts = JointActorCritic(sizes, seeds, config, statistics, device)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves."""
        config = self.config
        scale = cosine(self.n_updates, config.n_updates, config.final_step_size)
        x = self.parts.information(batch.states, batch.observations)
        losses = self._update_critics(batch, x, scale)
        self.n_updates += 1
        is_warm = self.n_updates <= config.warm_start
        if is_warm or self.n_updates % config.policy_delay == 0:
            losses |= self._clone(batch, scale) if is_warm else self._improve(batch, x, scale)
            self.parts.follow()
        return {name: loss.detach() for name, loss in losses.items()}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        return self.parts.bootstrapped(batch, self.parts.next_policy_actions(batch))

    def gap(self, batch: Batch, x: Tensor, q: Tensor) -> Tensor:
        """Returns each critic's own penalty, [K, 2]; draws joint actions.

        Args:
            batch: tensors [K, B, ...].
            x: what the critics see, [K, B, S + N O].
            q: their values of the data's actions, [K, 2, B].
        """
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

    def _update_critics(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        y = self.targets(batch)  # [K, B]
        q = self.parts.critics.q(x, batch.actions)[..., 0]  # [K, 2, B]
        critic_loss = (q - y[:, None]).square().mean(2).sum(1)  # [K]
        gap = self.gap(batch, x, q).sum(1)  # [K]
        self.parts.critics.step(critic_loss + self.config.alpha * gap, scale)
        return {"critic_loss": critic_loss, "gap": gap, "q": q.mean((1, 2))}

    def _clone(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        pi = self.parts.actor(batch.observations)
        bc_loss = imitation(pi, batch.actions)
        self.parts.actor.step(bc_loss, scale)
        return {"bc_loss": bc_loss}

    def _improve(self, batch: Batch, x: Tensor, scale: float) -> dict[str, Tensor]:
        config, actions = self.config, batch.actions
        pi = self.parts.actor(batch.observations)  # [K, B, N, A]
        bc_loss = imitation(pi, actions)
        # the critics' parameters are constants here; [K, B N], or [K, B] for "all"
        q = self.parts.critics.policy_values(x, pi, actions, config.joint_gradient)[..., 0]
        size = q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        self.parts.actor.step(config.bc_weight * bc_loss - q.mean(1) / size, scale)
        return {"bc_loss": bc_loss, "policy_q": q.mean(1)}

    def policy(self, index: int) -> TorchPolicy:
        """The policy of seed number `index`, as it is now."""
        return self.parts.policy(index)

    def state_dict(self) -> dict[str, Any]:
        """Everything that training goes on from, as copies."""
        return {"n_updates": torch.tensor(self.n_updates), **self.parts.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        self.parts.load_state_dict(state)
