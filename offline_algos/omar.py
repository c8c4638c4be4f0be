"""OMAR: independent critics with CQL; actors follow them and the best action of a search.

Pan et al., "Plan better amid conservatism: offline multi-agent reinforcement learning with actor
rectification", ICML 2022. An actor that climbs a conservative critic stops at poor local optima, so
it is also pulled to the best action that a search finds. Each agent i learns of its own reward r_i:

    y_i    = r_i + gamma (1 - termination) min_j Q'_j(o'_i, i, pi'(o'_i, i) + clip(noise, -c, c))
    gap_ji = tau log integral exp(Q_j(o_i, i, b) / tau) db - Q_j(o_i, i, a_i)       (CQL, eq. 3)
    L(Q_j) = mean_i (Q_j(o_i, i, a_i) - y_i)^2 + alpha gap_ji               every update
    L(pi)  = mean_i (1 - rho) (-Q_1(o_i, i, pi) / q) + rho/A |pi - best_i|^2        (eq. 4)
             + w/A |pi - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

With rho 0 it is independent CQL with an imitation term. The search (algorithm 1) begins with mu = 0
and sigma = 2 and repeats `n_iterations` times:

    b_m ~ N(mu, sigma^2), clipped;   w_m = softmax_m(Q_1(o_i, i, b_m) / s)
    mu <- sum_m w_m b_m;             sigma <- sqrt(mean_m (b_m - mu)^2)

best_i is the action with the highest Q_1 among pi(o_i, i) and the samples of the last repetition.

Deviations:
- One network for all actors and one for each of the two critics, which see the agent's number; in
  the paper each agent has its own.
- s is the standard deviation of the samples' values. The paper has s = 1 and raw rewards; with
  scaled rewards the weights would be even.
- rho is 0.7 for all datasets; the authors choose 0.1 to 1 for each, and alpha as well (0.5 to 5).
  alpha and tau are in units of scaled rewards; `cfcql` says why tau is below 1.
- The penalty's samples are uniform, as in the authors' code for particle worlds.
- `gap_limit`, `clip_target` (as `maddpg_bc`, with the largest return-to-go of any robot) and
  `bc_weight` w, none of which the paper has: on data that are all alike, critics diverged.
- Warm-up, target smoothing, LayerNorm, normalization and learning rates are those of `maddpg_bc`.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import Critics
from swarmdata.learn.networks.network_inputs import (
    Normalizer,
    RobotRewards,
    normal_like,
    with_agent_id,
)
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.conservative import cql_gap, uniform_samples
from swarmdata.learn.objectives.losses import Loss, td_error, td_target, value_size
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.policies.trained import actor_policy
from swarmdata.learn.training.actor_critic import (
    EXTRACTION_LOSSES,
    LossActorCritic,
    TwoStageConfig,
    Valuer,
)
from swarmdata.learn.training.settings import Choice, Space
from swarmdata.offline_algos.cfcql import CONSERVATIVE_SPACE
from swarmdata.types import Batch


@dataclass(frozen=True)
class OMARConfig(TwoStageConfig):
    """Independent CQL with actor rectification; one setting for all datasets."""

    cql_weight: float = 0.5  # alpha, of the penalty; see the deviations above, also for tau
    temperature: float = 0.1  # of the soft maximum, tau in the penalty
    n_samples: int = 5  # of the penalty; 10 in the paper's code, at twice the cost
    gap_limit: float = 1.0  # a row whose gap is below minus this is not penalized further
    rectification: float = 0.7  # rho
    bc_weight: float = 1.5  # w; see the deviations above
    clip_target: bool = True
    n_iterations: int = 3  # of the search; the paper's code, the next two too
    n_candidates: int = 10
    search_deviation: float = 2.0  # sigma at the start


class OMAR(LossActorCritic):
    """K seeds of actors and two critics that see one agent, trained at once."""

    Config = OMARConfig
    FIELDS = ("observations", "actions", "rewards", "next_observations", "terminations")
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q", "search_loss", *EXTRACTION_LOSSES)
    SPACE: ClassVar[Space] = {**CONSERVATIVE_SPACE, "rectification": Choice((0.1, 0.3, 0.7, 0.9))}

    critics: Critics

    def __init__(self, setup: Setup, config: OMARConfig) -> None:
        n_inputs = setup.sizes.observation + setup.sizes.n_agents + setup.sizes.action
        critics = Critics(
            n_inputs, setup.seeds, config.critic_hidden,
            learning_rate=config.critic_learning_rate, max_norm=config.max_grad_norm,
            device=setup.device,
        )  # fmt: skip
        super().__init__(setup, config, critics)
        self.normalizer = Normalizer(setup.statistics, setup.device)
        self.rewards = RobotRewards(setup.statistics, "own", clip_target=config.clip_target)

    def critic_inputs(self, batch: Batch) -> Tensor:
        """Returns what the critics see besides actions, [K, B N, O + N]."""
        return self.inputs_of(batch.observations)

    def inputs_of(self, observations: Tensor) -> Tensor:
        """Returns critic inputs, [K, B N, O + N], of observations [K, B, N, O]."""
        return with_agent_id(self.normalizer.observations(observations)).flatten(1, 2)

    def critic_loss(self, batch: Batch, x: Tensor) -> Loss:
        """Returns sum_j L(Q_j); draws the targets' noise and the penalty's actions."""
        actions = by_agent(batch.actions)
        y = self.targets(batch)  # without a gradient
        q = self.critics.q(x, actions)[..., 0]  # [K, 2, B N]
        td_loss = td_error(q, y, batch.alive)  # [K]
        gap = self.gap(x, actions, q, batch.alive).sum(1)  # [K]
        reported = {"critic_loss": td_loss, "gap": gap, "q": q.mean((1, 2))}
        return Loss(td_loss + self.config.cql_weight * gap, reported)

    def valuer(self, batch: Batch, x: Tensor) -> Valuer:
        critics = self.critics
        return Valuer(
            lambda pi: critics.smallest_of(x, by_agent(pi)).view(pi.shape[:3]),
            lambda each: critics.smallest_of(x, each.flatten(1, 2)).view(each.shape[:4]),
        )

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y_i, [K, B N], in units of scaled rewards; draws the smoothing noise."""
        a_next = by_agent(self.smoothed_actions(batch))
        x_next = self.inputs_of(batch.next_observations)
        q_next = self.critics.target_q(x_next, a_next)[..., 0].amin(1)  # [K, B N], the smaller one
        q_next = q_next.clamp(max=self.rewards.max_value)
        r = self.rewards(batch.rewards)  # [K, B, N]
        ends = self.rewards.ends(batch).expand_as(r)
        return td_target(r.flatten(1), ends.flatten(1), q_next, self.config.discount)

    def gap(self, x: Tensor, actions: Tensor, q: Tensor, alive: Tensor | None) -> Tensor:
        """Returns gap_j, [K, 2], the mean over agents that are `alive`; draws actions.

        Critics see x, [K, B N, O + N]; their values of the data's actions, [K, B N, 1, A], are q,
        [K, 2, B N].
        """
        samples = uniform_samples(self.generators, actions, self.config.n_samples)
        values = self.critics.sampled_q(x, samples.actions)[..., 0]  # [K, 2, B N, M]
        config = self.config
        settings = config.temperature, config.gap_limit
        return cql_gap(samples.log_density, values, q, *settings, alive)

    def actor_loss(self, batch: Batch, x: Tensor, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns L(pi), eq. 4; the critics' parameters and the search's actions are constants."""
        rho, pi = self.config.rectification, by_agent(pi)  # [K, B N, 1, A]
        alive = None if batch.alive is None else batch.alive.flatten(1)[..., None]  # [K, B N, 1]
        search_loss = agent_mean((pi - self.search(x, pi)).square(), alive)  # [K]
        q = self.critics.first_q(x, pi)  # [K, B N, 1]
        policy_q = agent_mean(q, alive)
        rectified = rho * search_loss - (1 - rho) * policy_q / value_size(q, alive)
        reported = {"policy_q": policy_q, "search_loss": search_loss}
        return Loss(rectified + self.config.bc_weight * bc_loss, reported)

    @torch.no_grad()
    def search(self, x: Tensor, pi: Tensor) -> Tensor:
        """Returns the best actions found, [K, B N, 1, A], pi among them; draws the candidates.

        Policies act by pi, [K, B N, 1, A], where critics see x, [K, B N, O + N].
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

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        return actor_policy(self.actor.online, index)


def by_agent(actions: Tensor) -> Tensor:
    """Returns actions [K, B, N, A] as those of teams of one, [K, B N, 1, A]."""
    return actions.flatten(1, 2)[:, :, None]
