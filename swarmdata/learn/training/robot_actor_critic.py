"""The parts that actor-critics share whose critics give one value for each robot.

The losses are in the files of the algorithms. An algorithm takes these functions as its methods,
beside those of `actor_critic`:

    critic_inputs, bc_loss, actor_loss = robot_inputs, staticmethod(cloning_loss), robot_actor_loss
"""

from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from swarmdata.learn.extraction.valuers import RobotValuer
from swarmdata.learn.networks.actor import DelayedActor
from swarmdata.learn.networks.critics import JointGradient
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.robot_critics import RobotCritics
from swarmdata.learn.networks.robot_views import Critic, RobotView
from swarmdata.learn.objectives.robot_rewards import Reward, RobotRewards
from swarmdata.learn.objectives.td_targets import td_error
from swarmdata.learn.training.actor_critic import Loss, TwoStageConfig, delayed_actor
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class ConservativeConfig(TwoStageConfig):
    """Settings of actor-critics whose critics are penalized; see `cfcql` for the units."""

    cql_weight: float = 0.5  # alpha, of the penalty
    temperature: float = 0.1  # of the soft maximum, tau in the penalty
    gap_limit: float = 1.0  # a row whose gap is below minus this is not penalized further
    bc_weight: float = 0.1  # w
    reward: Reward = "own"
    clip_target: bool = True


RobotParts = tuple[DelayedActor, RobotCritics, RobotRewards]


def robot_parts(setup: Setup, config: ConservativeConfig, critic: Critic) -> RobotParts:
    """Makes the actors, the two critics of each seed, and the rewards that they learn from."""
    critics = RobotCritics(
        setup.sizes, Normalizer(setup.statistics, setup.device), critic, setup.seeds,
        config.critic_hidden, learning_rate=config.critic_learning_rate,
        max_norm=config.max_grad_norm, device=setup.device,
    )  # fmt: skip
    rewards = RobotRewards(setup.statistics, config.reward, clip_target=config.clip_target)
    return delayed_actor(setup, config), critics, rewards


class RobotActorCritic(Protocol):
    """Actors, and critics with one value for each robot."""

    @property
    def critics(self) -> RobotCritics: ...
    @property
    def config(self) -> Any: ...


class PenalizedActorCritic(RobotActorCritic, Protocol):
    """An actor-critic whose critics are pushed down where they exceed the data."""

    def targets(self, batch: Batch) -> Tensor:
        """Returns y_i, [K, B, N], without a gradient."""
        ...

    def gap(self, batch: Batch, x: RobotView, q: Tensor) -> Tensor:
        """Returns gap_j, [K, J], given Q_ji of the data's actions, [K, J, B, N]."""
        ...


def robot_inputs(self: RobotActorCritic, batch: Batch) -> RobotView:
    """Returns what the critics see of a batch besides actions."""
    return self.critics.view(batch.states, batch.observations)


def robot_valuer(self: RobotActorCritic, batch: Batch, x: RobotView) -> RobotValuer:
    """Returns the critics' values of the batch's actions, for a second stage."""
    return RobotValuer(self.critics, x, batch.actions, self.config.joint_gradient)


def penalized_critic_loss(self: PenalizedActorCritic, batch: Batch, x: RobotView) -> Loss:
    """Returns sum_j [L_td(Q_j) + cql_weight gap_j], [K]; draws the noise of targets and penalty.

    Args:
        self: whose targets, without a gradient, and whose penalty.
        batch: tensors [K, B, ...].
        x: what the critics see.
    """
    y = self.targets(batch)  # [K, B, N], without a gradient
    q = self.critics.q(x, batch.actions)  # [K, 2, B, N]
    td_loss = td_error(q.flatten(2), y.flatten(1))  # [K]
    gap = self.gap(batch, x, q).sum(1)  # [K]
    reported = {"critic_loss": td_loss, "gap": gap, "q": q.mean((1, 2, 3))}
    return Loss(td_loss + self.config.cql_weight * gap, reported)


def robot_actor_loss(
    self: RobotActorCritic, batch: Batch, x: RobotView, pi: Tensor, bc_loss: Tensor
) -> Loss:
    """Returns mean_i [-Q_1i(x, (pi_i, .)) / q] + w bc_loss, [K]; the critics are constants.

    q = max(mean_i |Q_1i|, 1), detached. Both terms are means over robots, so that the pull of Q
    and of the data on one robot are the same in teams of any size.

    Args:
        self: whose critics, and whose `joint_gradient` and `bc_weight`.
        batch: tensors [K, B, ...].
        x: what the critics see.
        pi: actions of the policies, [K, B, N, A].
        bc_loss: `cloning_loss`, [K].
    """
    gradient: JointGradient = self.config.joint_gradient
    others = batch.actions if gradient == "own" else pi
    q = self.critics.first_q(x, pi, others)  # [K, B, N]
    size = q.detach().abs().mean((1, 2)).clamp(min=1.0)  # [K]
    mean = q.mean((1, 2))
    return Loss(self.config.bc_weight * bc_loss - mean / size, {"policy_q": mean})
