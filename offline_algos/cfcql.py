"""CFCQL: critics pessimistic about each robot that alone leaves the data; others' actions stay.

Shao et al., "Counterfactual conservative Q-learning for offline multi-agent reinforcement
learning", NeurIPS 2023. Kumar et al.'s penalty (CQL, 2020) on joint actions grows with the number
of agents; here agent i's action b is sampled, and the others' are those of the data (eq. 5 and 6):

    y_i    = r_i + gamma (1 - termination) min_j Q'_ji(x', pi'(o') + clip(noise, -c, c))
    gap_j  = mean_i [tau log integral exp(Q_ji(x, (b, a_-i)) / tau) db - Q_ji(x, a)]
    L(Q_j) = mean_i (Q_ji(x, a) - y_i)^2 + alpha gap_j                      every update
    L(pi)  = mean_i -Q_1i(x, (pi(o_i), a_-i)) / q + w 1/A |pi(o_i, i) - a_i|^2
             every `policy_delay`-th; q = max(mean |Q_1|, 1), detached

Q_ji is the value of robot i's own rewards r_i (`reward: team`: the mean over robots), from a
centralized view of it (`networks.critics`), here x. Without the penalty (alpha 0) it is MADDPG
with an imitation term.

Deviations:
- The paper has one value of a reward that all agents share. Of rewards that are each robot's own, a
  mean over the team hides what one robot's action did (`networks.network_inputs`).
- lambda_i = 1/N, the paper's uniform weights; its weights by the distance from the data need a
  model of the data's actions.
- Sampled actions are uniform, as in the authors' code for particle worlds.
- alpha and tau are in units of scaled rewards, of which the returns-to-go have deviation 1, and one
  pair serves all datasets. The authors choose alpha for each (0.3 to 5) in raw rewards, whose
  values are tens of times as large, with tau 1: that is a tau of a few hundredths here.
- `gap_limit`: the penalty ends where it has done its work; `conservative.cql_gap` says why.
- The authors make 5 critic steps for one of the actors; here it is `policy_delay` 2.
- Networks, warm-up, target smoothing, LayerNorm, `clip_target`, normalization and learning rates
  are those of `maddpg_bc`, which has their sources.
- `bc_weight` w: the paper has none.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointGradient, RobotCritics, RobotView, others_of
from swarmdata.learn.networks.network_inputs import Reward, RobotRewards
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.conservative import (
    cql_gap,
    repeated,
    uniform_log_density,
    uniform_samples,
)
from swarmdata.learn.objectives.losses import Loss, td_error, td_target, value_size
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.policies.trained import actor_policy
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    EXTRACTION_LOSSES,
    TRANSITION,
    LossActorCritic,
    TwoStageConfig,
    Valuer,
    robot_critics,
    robot_valuer,
)
from swarmdata.learn.training.settings import LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class ConservativeConfig(TwoStageConfig):
    """Settings of critics of each robot that are penalized; above are the units."""

    cql_weight: float = 0.5  # alpha, of the penalty
    temperature: float = 0.1  # of the soft maximum, tau in the penalty
    gap_limit: float = 1.0  # a row whose gap is below minus this is not penalized further
    bc_weight: float = 0.1  # w
    reward: Reward = "own"
    clip_target: bool = True


CONSERVATIVE_SPACE: Space = {
    **ACTOR_CRITIC_SPACE,
    "cql_weight": LogUniform(3e-3, 10.0),  # the better the data, the larger
    "bc_weight": LogUniform(1e-2, 10.0),
}


@dataclass(frozen=True)
class CFCQLConfig(ConservativeConfig):
    """Counterfactual CQL: the gradient of one's own action, as in the paper's code."""

    n_samples: int = 5  # of each robot's actions; 10 in the paper's code, at twice the cost
    joint_gradient: JointGradient = "own"


class CFCQL(LossActorCritic):
    """K seeds of actors and two critics with counterfactual penalties, trained at once."""

    Config: type[ConservativeConfig] = CFCQLConfig
    FIELDS = TRANSITION
    LOSSES = ("critic_loss", "gap", "q", "bc_loss", "policy_q", *EXTRACTION_LOSSES)
    SPACE: ClassVar[Space] = CONSERVATIVE_SPACE

    critics: RobotCritics

    def __init__(self, setup: Setup, config: ConservativeConfig) -> None:
        super().__init__(setup, config, robot_critics(setup, config, "centralized"))
        self.rewards = RobotRewards(setup.statistics, config.reward, clip_target=config.clip_target)

    def critic_inputs(self, batch: Batch) -> RobotView:
        return self.critics.view(batch.states, batch.observations)

    def critic_loss(self, batch: Batch, x: RobotView) -> Loss:
        """Returns sum_j L(Q_j), [K]; draws the noise of targets and penalty."""
        y = self.targets(batch)  # [K, B, N], without a gradient
        q = self.critics.q(x, batch.actions)  # [K, 2, B, N]
        td_loss = td_error(q.flatten(2), y.flatten(1), self.rewards.learned(batch))  # [K]
        gap = self.gap(batch, x, q).sum(1)  # [K]
        reported = {"critic_loss": td_loss, "gap": gap, "q": q.mean((1, 2, 3))}
        return Loss(td_loss + self.config.cql_weight * gap, reported)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y_i, [K, B, N], in units of scaled rewards; draws the smoothing noise."""
        own, others = self.next_actions(batch)
        x_next = self.critics.view(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(x_next, own, others).amin(1)  # [K, B, N], the smaller one
        q_next = q_next.clamp(max=self.rewards.max_value)
        ends = self.rewards.ends(batch)
        return td_target(self.rewards(batch.rewards), ends, q_next, self.config.discount)

    def next_actions(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Returns a robot's next action in its own value, and the others' in it, [K, B, N, A]."""
        pi_next = self.smoothed_actions(batch)
        return pi_next, pi_next

    def gap(self, batch: Batch, x: RobotView, q: Tensor) -> Tensor:
        """Returns gap_j, [K, 2], given Q_ji(x, a), [K, 2, B, N]; draws the robots' actions."""
        actions, n_samples = batch.actions, self.config.n_samples
        samples = uniform_samples(self.generators, actions, n_samples)
        others = repeated(actions, n_samples)
        values = self.critics.sampled_q(x, samples.actions, others)  # [K, 2, B, N, M]
        density = torch.full_like(values[:, 0], uniform_log_density(actions.shape[3]))
        return self.mean_gap(density, values, q, self.rewards.learned(batch))

    def mean_gap(
        self, log_density: Tensor, values: Tensor, q: Tensor, alive: Tensor | None
    ) -> Tensor:
        """Returns the mean over robots of `cql_gap`, [K, 2].

        Samples have log densities [K, B, N, M] and values [K, 2, B, N, M], the data's actions q,
        [K, 2, B, N]; `alive`, [K, B, N], is None where all robots count.
        """
        flat = log_density.flatten(1, 2), values.flatten(2, 3), q.flatten(2)
        return cql_gap(*flat, self.config.temperature, self.config.gap_limit, alive)

    def actor_loss(self, batch: Batch, x: RobotView, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns L(pi), [K]; the critics' parameters are constants."""
        others = others_of(self.config.joint_gradient, pi, batch.actions)
        q = self.critics.first_q(x, pi, others)  # [K, B, N]
        mean = agent_mean(q, batch.alive)
        loss = self.config.bc_weight * bc_loss - mean / value_size(q, batch.alive)
        return Loss(loss, {"policy_q": mean})

    def valuer(self, batch: Batch, x: RobotView) -> Valuer:
        return robot_valuer(self.critics, x, batch, self.config.joint_gradient)

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        return actor_policy(self.actor.online, index)
