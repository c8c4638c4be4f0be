"""MADDPG+BC: critics of each robot's own reward improve actors that stay close to the data.

The first stage is TD3+BC (Fujimoto & Gu 2021, eq. 3-5) with the critics of MADDPG (Lowe et al.
2017, eq. 6), one value for each robot i of its own reward r_i; with two critics it is MATD3
(Ackermann et al. 2019, section 4). With `critic` "centralized", x_i = (o_i, i, s) and the critic
sees all actions; "decentralized", it sees (o_i, i, a_i): the MA-TD3+BC of OMAR's tables (Pan et al.
2022).

    y_i    = r_i + gamma (1 - termination) min_j Q'_j(x'_i, pi'(o') + clip(noise, -c, c))
    L(Q_j) = 1/N sum_i (Q_j(x_i, a) - y_i)^2                                every update
    L(pi)  = 1/N sum_i 1/A |pi(o_i, i) - a_i|^2 - lambda Q_1(x_i, pi(o))    every `policy_delay`-th
    lambda = alpha / max(mean |Q_1(x, pi(o))|, 1), detached

In the second stage the actor is extracted from the critics, which go on learning its value;
`learn.objectives.losses` has its losses. By default it climbs, by slopes of Q of bounded length and
with a behavior density beta that was learned in the first stage,

    1/N sum_i min_j Q_j(x_i, pi(o)) + 1/eta log beta(pi(o_i, i) | o_i)

Where a second stage follows, the first one has alpha `first_rl_weight` 0: its actor clones the data
and the critics value the clone, so that policy improvement begins with a sound value
(Brandfonbrener et al. 2021, "Offline RL without off-policy evaluation"; with `frozen_critics`, one
step is all there is). Otherwise critics learn the value of actors that they themselves lead astray
where data are narrow.

Deviations:
- Actors are one network for all robots, which sees the robot's number, and so are the critics.
- `reward` "team" has the mean of all r_i in place of r_i: that spreads the signal of each robot
  over the team, and the weight of Q on one robot's action falls with the team's size.
- `joint_gradient` "all": Q sees every robot's action from its policy (the centralized gradient of
  FACMAC, Peng et al. 2021, eq. 7). "own" is MADDPG's eq. 6: robot i's action from its policy and
  the others' from the data, which can fail to coordinate (Tilbury et al. 2024, arXiv 2407.01343).
- Frames: a critic of robot i sees everything in robot i's frame (`networks.critics`).
- mean |Q_1| is taken as at least 1, which is one standard deviation of the returns-to-go: returns
  cross 0, where the paper's lambda explodes.
- Value and imitation are both means over robots, so that a robot is held to the data, and pulled by
  its value, as strongly in a team as alone.
- The critics have LayerNorm. Observations and states are normalized with the dataset's statistics,
  rewards are divided by the standard deviation of a robot's returns-to-go.
- `clip_target`: y uses min(Q', R*), with R* the largest discounted return-to-go of the dataset (the
  critic clipping of B3C, Kim et al. 2026, with a tighter bound).
- Warm-up: in the first `bc_warmup_share` of the updates lambda is 0 and actors move
  in every update, so that they clone the data while critics are still noise.
- Learning rates decay along a cosine in each stage, as that of behavior cloning does.
- The learning rates are 3e-3; the paper's 3e-4 is for a million updates and does not decay.
- The discount is 0.95 per control step, not the paper's 0.99: rewards for progress and contact are
  dense, so that 20 steps (2 s) hold the consequences of an action.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.learn.networks.compilation import compilable
from swarmdata.learn.networks.critics import (
    Critic,
    JointGradient,
    RobotCritics,
    RobotView,
    others_of,
)
from swarmdata.learn.networks.network_inputs import Reward, RobotRewards, normal_like
from swarmdata.learn.networks.presence import acting, agent_mean, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import cloning_loss, td_error, td_target, value_size
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.policies.trained import actor_policy
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    EXTRACTION_LOSSES,
    SECOND_STAGES,
    TRANSITION,
    Extraction,
    TwoStageActorCritic,
    TwoStageConfig,
    Valuer,
    robot_critics,
    robot_valuer,
)
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class MADDPGBCConfig(TwoStageConfig):
    """TD3+BC with a critic for each robot, and its second stage; one setting for all datasets."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        "rl_weight": ("extraction", ("joint",)),
        "first_rl_weight": ("extraction", SECOND_STAGES),
        "joint_gradient": ("critic", ("centralized",)),
    }

    extraction: Extraction = "anchored"
    extraction_share: float = 0.33
    rl_weight: float = 2.5  # alpha of `joint`; Fujimoto & Gu 2021, table 3
    first_rl_weight: float = 0.0  # alpha of the first of two stages, see above
    critic: Critic = "centralized"
    reward: Reward = "own"
    joint_gradient: JointGradient = "all"
    clip_target: bool = True


class MADDPGBC(TwoStageActorCritic):
    """K seeds of actors and two critics, trained at once; its gradients can be compiled."""

    Config = MADDPGBCConfig
    FIELDS = TRANSITION
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda", *EXTRACTION_LOSSES)
    SPACE: ClassVar[Space] = {
        **ACTOR_CRITIC_SPACE,
        "inverse_temperature": LogUniform(0.3, 10.0),
        "extraction_share": Choice((0.2, 0.33, 0.5)),
        "critic": Choice(("centralized", "decentralized")),
    }

    critics: RobotCritics

    def __init__(self, setup: Setup, config: MADDPGBCConfig) -> None:
        super().__init__(setup, config, robot_critics(setup, config, config.critic))
        self.rewards = RobotRewards(setup.statistics, config.reward, clip_target=config.clip_target)

    def critic_inputs(self, batch: Batch) -> RobotView:
        return self.critics.view(batch.states, batch.observations)

    def critic_step(self, batch: Batch, x: RobotView, scale: float) -> dict[str, Tensor]:
        reported = self.critic_gradient(batch, x, normal_like(self.generators, batch.actions))
        self.critics.descend(scale)
        return reported

    @compilable
    def critic_gradient(self, batch: Batch, x: RobotView, noise: Tensor) -> dict[str, Tensor]:
        """Fills the critics' gradients with that of sum_j L(Q_j); returns losses, each [K]."""
        y = self.targets(batch, noise)
        q = self.critics.q(x, batch.actions)  # [K, 2, B, N]
        critic_loss = td_error(q.flatten(2), y.flatten(1), self.rewards.learned(batch))  # [K]
        self.critics.online.backward(critic_loss.sum())
        return {"critic_loss": critic_loss.detach(), "q": q.detach().mean((1, 2, 3))}

    @torch.no_grad()
    def targets(self, batch: Batch, noise: Tensor) -> Tensor:
        """Returns y_i, [K, B, N], in units of scaled rewards, of transitions [K, B, ...].

        `noise`, of the smoothing of target policies, is standard normal, [K, B, N, A].
        """
        o_next, config = batch.next_observations, self.config
        a_next = self.actor.smoothed(noise, o_next, config.smoothing, config.smoothing_clip)
        a_next = acting(a_next, going_on(batch))
        x_next = self.critics.view(batch.next_states, o_next)
        q_next = self.critics.target_q(x_next, a_next).amin(1)  # [K, B, N], the smaller one
        q_next = q_next.clamp(max=self.rewards.max_value)
        ends = self.rewards.ends(batch)
        return td_target(self.rewards(batch.rewards), ends, q_next, config.discount)

    @torch.no_grad()
    def td_error(self, batch: Batch) -> Tensor:
        """The mean of (Q_j - y)^2 over critics, robots and rows, [K], in units of rewards squared.

        y is without noise.
        """
        y = self.targets(batch, torch.zeros_like(batch.actions))  # [K, B, N]
        q = self.critics.q(self.critic_inputs(batch), batch.actions)  # [K, 2, B, N]
        error = td_error(q.flatten(2), y.flatten(1), self.rewards.learned(batch))  # of two critics
        return error / (2 * self.rewards.scale**2)

    def actor_step(
        self, batch: Batch, x: RobotView, scale: float, is_warmup: bool
    ) -> dict[str, Tensor]:
        config = self.config
        alpha = config.rl_weight if self.second_stage is None else config.first_rl_weight
        reported = self.actor_gradient(batch, x, 0.0 if is_warmup else alpha)
        self.actor.descend(scale)
        return reported

    @compilable
    def actor_gradient(self, batch: Batch, x: RobotView, rl_weight: float) -> dict[str, Tensor]:
        """Fills the actors' gradients with that of L(pi); returns losses, each [K].

        Critics see x of the batch, [K, B, ...]; `rl_weight` is alpha, 0 clones the data.
        """
        pi = acting(self.actor(batch.observations), batch.alive)  # [K, B, N, A]
        bc_loss = actor_loss = cloning_loss(pi, batch.actions, batch.alive)  # [K]
        losses = {"bc_loss": bc_loss}
        if rl_weight != 0:
            others = others_of(self.config.joint_gradient, pi, batch.actions)
            q = self.critics.first_q(x, pi, others)  # [K, B, N]; parameters are constants
            lam = rl_weight / value_size(q, batch.alive)  # [K]
            policy_q = agent_mean(q, batch.alive)
            actor_loss = bc_loss - lam * policy_q
            losses |= {"policy_q": policy_q, "lambda": lam}
        self.actor.online.network.backward(actor_loss.sum())
        return {name: loss.detach() for name, loss in losses.items()}

    def valuer(self, batch: Batch, x: RobotView) -> Valuer:
        return robot_valuer(self.critics, x, batch, self.config.joint_gradient)

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        return actor_policy(self.actor.online, index)
