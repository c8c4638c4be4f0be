"""MADDPG+BC: a centralized critic improves actors that stay close to the dataset's actions.

The algorithm is TD3+BC (Fujimoto & Gu 2021, eq. 3-5) with the critic of MADDPG (Lowe et al. 2017,
eq. 6), which sees x = (state, all observations) and all actions; in the twin-critic form it is
MATD3 (Ackermann et al. 2019, section 4). With team reward r, the mean over agents:

    y      = r + gamma (1 - termination) min_j Q'_j(x', pi'(o') + clip(noise, -c, c))
    L(Q_j) = (Q_j(x, a) - y)^2                                              every update
    L(pi)  = -lambda Q_1(x, pi(o)) + sum_i 1/A |pi(o_i, i) - a_i|^2         every `policy_delay`-th
    lambda = alpha / max(mean |Q_1(x, pi(o))|, 1), detached

Deviations:
- Actors are one network for all agents, which sees the agent's number.
- `joint_gradient` "all": Q sees every agent's action from its policy (the centralized gradient of
  FACMAC, Peng et al. 2021, eq. 7). "own" is MADDPG's eq. 6: agent i's action from its policy and
  the others' from the data, which can fail to coordinate (Tilbury et al. 2024, arXiv 2407.01343).
- mean |Q_1| is taken as at least 1, which is one standard deviation of the returns-to-go: team
  returns cross 0, where the paper's lambda explodes (measured: 17 instead of 2.5, and policies that
  push through obstacles).
- The imitation error is summed over agents and averaged over action components, so that an agent
  is held to the data as strongly in a team as alone.
- The critics have LayerNorm. Observations and states are normalized with the dataset's statistics,
  rewards are divided by the standard deviation of the returns-to-go.
- `clip_target`: y uses min(Q', R*), with R* the largest discounted return-to-go of the dataset (the
  critic clipping of B3C, Kim et al. 2026, with a tighter bound).
- Warm start: during the first `warm_start` updates lambda is 0 and actors move in every update, so
  that they clone the data while critics are still noise.
- Step sizes decay along a cosine, as those of behavior cloning do.
- The critics' step size is 1e-3, the paper's 3e-4 is for a million updates and does not decay; that
  of actors is the one of `bc`, which has measured it.
- The discount is 0.95 per control step, not the paper's 0.99: rewards for progress and contact are
  dense, so that 20 steps (2 s) hold the consequences of an action. Its effect was not isolated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.compilation import compilable
from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.joint_actor_critic import JointActorCritic, imitation
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.learn.training.exploration import normal_like
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGBCConfig:
    """TD3+BC with a centralized critic; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 256  # joint transitions
    actor_hidden: tuple[int, ...] = (128, 128)
    critic_hidden: tuple[int, ...] = (128, 128)
    step_size: float = 3e-3  # see `bc`
    critic_step_size: float = 1e-3  # see the deviations above
    final_step_size: float = 0.0  # factor at the end of the cosine; 1 keeps the step sizes
    discount: float = 0.95  # see the deviations above
    polyak: float = 0.01  # per actor update; 0.005 was too slow for 20,000 updates
    policy_delay: int = 2  # Fujimoto & Gu 2021, table 3; the next three too
    noise: float = 0.2
    noise_clip: float = 0.5
    alpha: float = 2.5  # Fujimoto & Gu 2021, table 3
    joint_gradient: JointGradient = "all"
    clip_target: bool = True
    warm_start: int = 4000
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class MADDPGBC:
    """K seeds of actors and twin critics, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization, reward scale and R*.
        device: where to train.
    """

    Config = MADDPGBCConfig
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: MADDPGBCConfig,
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
        noise = normal_like(self.parts.generators, batch.actions)
        x = self.parts.information(batch.states, batch.observations)
        losses = self._critic_gradient(batch, x, noise)
        self.parts.critics.optimizer.descend(scale)
        self.n_updates += 1
        is_warm = self.n_updates <= config.warm_start
        if is_warm or self.n_updates % config.policy_delay == 0:
            losses |= self._actor_gradient(batch, x, 0.0 if is_warm else config.alpha)
            self.parts.actor.optimizer.descend(scale)
            self.parts.follow()
        return losses

    @compilable
    def _critic_gradient(self, batch: Batch, x: Tensor, noise: Tensor) -> dict[str, Tensor]:
        y = self.targets(batch, noise)  # [K, B]
        q = self.parts.critics.q(x, batch.actions)[..., 0]  # [K, 2, B]
        critic_loss = (q - y[:, None]).square().mean(2).sum(1)  # [K]
        self.parts.critics.online.backward(critic_loss.sum())
        return {"critic_loss": critic_loss.detach(), "q": q.detach().mean((1, 2))}

    @torch.no_grad()
    def targets(self, batch: Batch, noise: Tensor) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards.

        Args:
            batch: tensors [K, B, ...].
            noise: standard normal, [K, B, N, A], of the target policies' smoothing.
        """
        o_next, config = batch.next_observations, self.config
        a_next = self.parts.actor.smoothed_by(noise, o_next, config.noise, config.noise_clip)
        return self.parts.bootstrapped(batch, a_next)

    @torch.no_grad()
    def td_error(self, batch: Batch) -> Tensor:
        """Returns the mean of (Q_j - y)^2, [K], over critics and rows; y without noise."""
        y = self.targets(batch, torch.zeros_like(batch.actions))  # [K, B]
        x = self.parts.information(batch.states, batch.observations)
        q = self.parts.critics.q(x, batch.actions)  # [K, 2, B, 1]
        return (q[..., 0] - y[:, None]).square().mean((1, 2))

    @compilable
    def _actor_gradient(self, batch: Batch, x: Tensor, alpha: float) -> dict[str, Tensor]:
        parts, actions = self.parts, batch.actions
        pi = parts.actor(batch.observations)  # [K, B, N, A]
        bc_loss = imitation(pi, actions)
        losses = {"bc_loss": bc_loss}
        actor_loss = bc_loss
        if alpha != 0:
            # [K, B], or [K, B N] for "own"; the critics' parameters are constants here
            q = parts.critics.policy_values(x, pi, actions, self.config.joint_gradient)[..., 0]
            lam = alpha / q.detach().abs().mean(1).clamp(min=1.0)  # [K]
            actor_loss = bc_loss - lam * q.mean(1)
            losses |= {"policy_q": q.mean(1), "lambda": lam}
        parts.actor.online.network.backward(actor_loss.sum())
        return {name: loss.detach() for name, loss in losses.items()}

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
