"""OMAR: independent critics with CQL; actors follow them and the best action of a search.

Pan et al., "Plan better amid conservatism: offline multi-agent reinforcement learning with actor
rectification", ICML 2022. An actor that climbs a conservative critic stops at poor local optima, so
it is also pulled to the best action that a search finds. Each agent i learns of its own reward r_i:

    y_i    = r_i + gamma (1 - termination) min_j Q'_j(o'_i, i, pi'(o'_i, i) + clip(noise, -c, c))
    gap_ji = tau log integral exp(Q_j(o_i, i, b) / tau) db - Q_j(o_i, i, a_i)       (CQL, eq. 3)
    L(Q_j) = mean_i (Q_j(o_i, i, a_i) - y_i)^2 + alpha gap_ji               every update
    L(pi)  = mean_i (1 - rho) (-Q_1(o_i, i, pi) / q) + rho |pi - best_i|^2          (eq. 4)
             + w |pi - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

The search (algorithm 1) begins with mu = 0 and sigma = 2 and repeats `n_iterations` times:

    b_m ~ N(mu, sigma^2), clipped;   w_m = softmax_m(Q_1(o_i, i, b_m) / s)
    mu <- sum_m w_m b_m;             sigma <- sqrt(mean_m (b_m - mu)^2)

best_i is the action with the highest Q_1 among pi(o_i, i) and the samples of the last repetition.

Deviations:
- One network for all actors and one for each twin, which see the agent's number; the paper's agents
  have their own.
- s is the standard deviation of the samples' values. The paper has s = 1 and raw rewards; with
  scaled rewards the weights would be even.
- rho is 0.7 for all datasets; the authors choose 0.1 to 1 for each, and alpha as well (0.5 to 5).
  alpha and tau are in units of scaled rewards; `cfcql` says why tau is below 1.
- The penalty's samples are uniform, as in the authors' code for particle worlds. Their code for
  HalfCheetah also samples near the policies, and subtracts those samples' density where its
  logarithm is meant.
- `bc_weight` w: the paper has none. With w = 0 values fell without end on `coop_nav-expert` (2
  seeds, 3,000 updates of 128 rows, critics of 64 units): policies that leave narrow data are
  penalized, and so are then the targets that they give. The score was -322.
- No `clip_target`: the largest return of the team does not bound that of an agent.
- Rewards are divided by the deviation of the team's returns-to-go. Warm start, target smoothing,
  LayerNorm, normalization and step sizes are those of `maddpg_bc`, which has their sources.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import DelayedActor
from swarmdata.learn.networks.critics import Critics
from swarmdata.learn.networks.network_inputs import (
    generator_states,
    generators,
    restore_generators,
    with_agent_id,
)
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.conservative import soft_maximum, uniform_samples
from swarmdata.learn.objectives.td_targets import td_target
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.learn.training.exploration import normal_like
from swarmdata.types import Batch


@dataclass(frozen=True)
class OMARConfig:
    """Independent CQL with actor rectification; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 256  # joint transitions, each with the actions of N agents
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
    n_samples: int = 5  # of the penalty; 10 in the paper's code, at twice the cost
    rectification: float = 0.7  # rho
    bc_weight: float = 0.4  # w; see the deviations above
    n_iterations: int = 3  # of the search; the paper's code, the next two too
    n_candidates: int = 10
    search_deviation: float = 2.0  # sigma at the start
    warm_start: int = 4000  # updates in which the actors clone the data
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class OMAR:
    """K seeds of actors and twin critics that see one agent, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization and reward scale.
        device: where to train.
    """

    Config = OMARConfig
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q", "search_loss")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: OMARConfig,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.config, self.n_updates, norm = config, 0, config.max_gradient_norm
        self.actor = DelayedActor(
            sizes, seeds, config.actor_hidden, statistics,
            step_size=config.step_size, max_norm=norm, device=device,
        )  # fmt: skip
        self.critics = Critics(
            sizes.observation + sizes.n_agents + sizes.action, seeds, config.critic_hidden,
            step_size=config.critic_step_size, max_norm=norm, device=device,
        )  # fmt: skip
        self.generators = generators(seeds, device)
        self.normalizer = Normalizer(statistics, device)
        self.reward_scale = 1 / statistics.return_std

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves."""
        config = self.config
        scale = cosine(self.n_updates, config.n_updates, config.final_step_size)
        x, actions = self.seen(batch.observations), by_agent(batch.actions)
        losses = self._update_critics(batch, x, actions, scale)
        self.n_updates += 1
        is_warm = self.n_updates <= config.warm_start
        if is_warm or self.n_updates % config.policy_delay == 0:
            pi = by_agent(self.actor(batch.observations))  # [K, B N, 1, A]
            bc_loss = (pi - actions).square().mean((1, 2, 3))  # [K]
            if is_warm:
                self.actor.step(bc_loss, scale)
            else:
                losses |= self._improve(x, pi, bc_loss, scale)
            losses["bc_loss"] = bc_loss
            self.actor.follow(config.polyak)
            self.critics.follow(config.polyak)
        return {name: loss.detach() for name, loss in losses.items()}

    def seen(self, observations: Tensor) -> Tensor:
        """Returns what a critic sees besides an action, [K, B N, O + N], of [K, B, N, O]."""
        return with_agent_id(self.normalizer.observations(observations)).flatten(1, 2)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B N], in units of scaled rewards; draws the smoothing noise."""
        config, o_next = self.config, batch.next_observations
        a_next = self.actor.smoothed(o_next, self.generators, config.noise, config.noise_clip)
        q_next = self.critics.target_q(self.seen(o_next), by_agent(a_next))[..., 0].amin(1)
        r = batch.rewards * self.reward_scale  # [K, B, N]
        over = batch.terminations[..., None].expand_as(r)
        return td_target(r.flatten(1), over.flatten(1), q_next, config.discount)

    def gap(self, x: Tensor, actions: Tensor, q: Tensor) -> Tensor:
        """Returns each critic's own penalty, [K, 2]; draws actions.

        Args:
            x: what the critics see, [K, B N, O + N].
            actions: of the data, [K, B N, 1, A].
            q: the critics' values of them, [K, 2, B N].
        """
        config = self.config
        samples = uniform_samples(self.generators, actions, config.n_samples)
        values = self.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B N, M]
        return (soft_maximum(values, samples.log_density, config.temperature) - q).mean(2)

    @torch.no_grad()
    def search(self, x: Tensor, pi: Tensor) -> Tensor:
        """Returns the best actions found, [K, B N, 1, A]; draws the candidates.

        Args:
            x: what the critics see, [K, B N, O + N].
            pi: actions of the policies, [K, B N, 1, A].
        """
        config = self.config
        mu = torch.zeros_like(pi)[:, :, None]  # [K, B N, 1, 1, A]
        sigma = torch.full_like(mu, config.search_deviation)
        for _ in range(config.n_iterations):
            noise = normal_like(self.generators, mu.expand(-1, -1, config.n_candidates, -1, -1))
            candidates = (mu + sigma * noise).clamp(-1, 1)
            values = self.critics.first_sampled_q(x, candidates)[..., 0]  # [K, B N, M]
            # a spread of 0 gives even weights
            spread = values.std(2, correction=0, keepdim=True).clamp(min=1e-6)
            weights = (values / spread).softmax(2)[..., None, None]
            mu = (weights * candidates).sum(2, keepdim=True)
            sigma = (candidates - mu).square().mean(2, keepdim=True).sqrt()
        options = torch.cat([candidates, pi[:, :, None]], 2)  # [K, B N, M + 1, 1, A]
        values = torch.cat([values, self.critics.first_q(x, pi)], 2)
        best = values.argmax(2)[:, :, None, None, None].expand(-1, -1, -1, 1, pi.shape[-1])
        return options.gather(2, best)[:, :, 0]

    def _update_critics(
        self, batch: Batch, x: Tensor, actions: Tensor, scale: float
    ) -> dict[str, Tensor]:
        y = self.targets(batch)  # [K, B N]
        q = self.critics.q(x, actions)[..., 0]  # [K, 2, B N]
        critic_loss = (q - y[:, None]).square().mean(2).sum(1)  # [K]
        gap = self.gap(x, actions, q).sum(1)  # [K]
        self.critics.step(critic_loss + self.config.alpha * gap, scale)
        return {"critic_loss": critic_loss, "gap": gap, "q": q.mean((1, 2))}

    def _improve(self, x: Tensor, pi: Tensor, bc_loss: Tensor, scale: float) -> dict[str, Tensor]:
        rho = self.config.rectification
        best = self.search(x, pi)  # a constant
        search_loss = (pi - best).square().mean((1, 2, 3))  # [K]
        # the critics' parameters are constants here
        q = self.critics.first_q(x, pi)[..., 0]  # [K, B N]
        size = q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        rectified = rho * search_loss - (1 - rho) * q.mean(1) / size
        self.actor.step(rectified + self.config.bc_weight * bc_loss, scale)
        return {"policy_q": q.mean(1), "search_loss": search_loss}

    def policy(self, index: int) -> TorchPolicy:
        """The policy of seed number `index`, as it is now."""
        return self.actor.policy(index)

    def state_dict(self) -> dict[str, Any]:
        """Everything that training goes on from, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "generators": generator_states(self.generators),
            **self.actor.state_dict(),
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        restore_generators(self.generators, state["generators"])
        self.actor.load_state_dict(state)
        self.critics.load_state_dict(state)


def by_agent(actions: Tensor) -> Tensor:
    """Returns actions [K, B, N, A] as those of teams of one, [K, B N, 1, A]."""
    return actions.flatten(1, 2)[:, :, None]
