"""PessimisticTeam: actors that climb joint critics which are penalized for leaving the data.

What CFCQL, ICQL-QS and MADDPG+CQL share; they differ in the penalty `gap` and the targets y:

    L(Q_j) = (Q_j(x, a) - y)^2 + alpha gap_j                                every update
    L(pi)  = -Q_1(x, pi) / q + w sum_i 1/A |pi(o_i, i) - a_i|^2             every `policy_delay`-th
    q      = max(mean |Q_1|, 1), detached

In the first `warm_start` updates actors clone the data, while the critics learn the value of that.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.joint_actor_critic import JointActorCritic, imitation
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch


@dataclass(frozen=True)
class PessimisticConfig:
    """Settings that penalized joint critics share; one setting for all datasets."""

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
    alpha: float = 0.5  # of the penalty; `cfcql` says why, also for tau
    temperature: float = 0.1  # tau
    n_samples: int = 10  # of actions for each row's penalty
    joint_gradient: JointGradient = "own"
    bc_weight: float = 0.4  # w; `cfcql` says why
    clip_target: bool = True
    warm_start: int = 4000  # updates in which the actors clone the data
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class PessimisticTeam(ABC):
    """K seeds of actors and twin critics, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization, reward scale and R*.
        device: where to train.
    """

    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: Any,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.config, self.n_updates = config, 0
        self.parts = JointActorCritic(sizes, seeds, config, statistics, device)

    @abstractmethod
    def gap(self, batch: Batch, x: Tensor, q: Tensor) -> Tensor:
        """Returns each critic's own penalty, [K, 2]; draws actions.

        Args:
            batch: tensors [K, B, ...].
            x: what the critics see, [K, B, S + N O].
            q: their values of the data's actions, [K, 2, B].
        """

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        return self.parts.bootstrapped(batch, self.parts.next_policy_actions(batch))

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
