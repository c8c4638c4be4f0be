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
  (2 seeds, 1,500 updates of 128 rows, hidden sizes 64, 100 episodes) the score was -141. So w is 1,
  the weight that MADDPG+BC at alpha 1 has. 0.25 held as well (1 seed, 900 updates: -63.6, MADDPG+BC
  -61.1); on other datasets values between were not compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.conservative import counterfactual_samples, draw_agents, soft_maximum
from swarmdata.learn.critics import JointGradient
from swarmdata.learn.joint import JointActorCritic, imitation
from swarmdata.learn.optimizer import cosine
from swarmdata.learn.policy import TorchPolicy
from swarmdata.learn.sizes import Sizes
from swarmdata.learn.statistics import Statistics
from swarmdata.types import Batch


@dataclass(frozen=True)
class CFCQLConfig:
    """Counterfactual CQL; one setting for all datasets."""

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
    alpha: float = 0.5  # of the penalty; see the deviations above, also for tau
    temperature: float = 0.1  # tau
    n_samples: int = 10  # the paper's code
    joint_gradient: JointGradient = "own"  # the paper's code
    bc_weight: float = 0.4  # w; see the deviations above
    clip_target: bool = True
    warm_start: int = 4000  # updates in which the actors clone the data
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class CFCQL:
    """K seeds of actors and twin critics, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization, reward scale and R*.
        device: where to train.
    """

    Config = CFCQLConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: CFCQLConfig,
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
        """Returns each critic's own penalty, [K, 2]; draws an agent and its actions for each row.

        Args:
            batch: tensors [K, B, ...].
            x: what the critics see, [K, B, S + N O].
            q: their values of the data's actions, [K, 2, B].
        """
        noise, config = self.parts.generators, self.config
        agents = draw_agents(noise, batch.actions)
        samples = counterfactual_samples(noise, batch.actions, agents, config.n_samples)
        values = self.parts.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B, M]
        highest = soft_maximum(values, samples.log_density, config.temperature)
        return (highest - q).mean(2)

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
