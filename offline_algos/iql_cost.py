"""IQL with costs: implicit Q-learning that also prefers the actions that lead to less cost.

Beside rewards r_i, robots have costs c_i, such as collisions (`numerics.event_costs`). The actor
clones rows by their rewards less lambda times their costs, as the Lagrangian of a constrained
Markov decision process has it (Altman 1999, "Constrained Markov Decision Processes"). With the
notation of `offline_algos.iql`, and q^c_i = max_j Q^c'_j(x_i, a):

    A_i      = u (q_i - V(x_i)) - lambda (q^c_i - V^c(x_i)),  w_r = exp(beta A_r)
    L(Q^c_j) = mean_i (c_i + gamma (1 - termination) V^c(x'_i) - Q^c_j(x_i, a))^2
    L(V^c)   = mean_i (q^c_i - V^c(x_i))^2

Rewards are valued as in `iql`, by an expectile above the mean: the better of the data's actions are
what will be done. Costs are valued by the mean, with the larger of two critics: what goes wrong is
as likely as in the data. One critic of their weighted sum could not do both. No action of a policy
enters a critic. lambda, `cost_weight`, says how many thousandths of the range of returns one event
costs.

Deviations:
- lambda is a setting, not the multiplier that keeps a budget, as in BCQ-Lag (Liu et al. 2023,
  arXiv 2306.09303). That needs an estimate of the policy's costs from the data alone, which do not
  tell of contacts that only the policy makes. So train several weights, and compare them with
  `swarmdata evaluate --validation --budget`.
- A robot's cost of a collision with another robot is half of it, the other half being that of the
  other robot; both prefer to avoid it alike.
- All others of `offline_algos.iql`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.critics import RobotView
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.presence import agent_mean, robot_ends
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import td_error, td_target
from swarmdata.learn.training.actor_critic import TRANSITION, robot_critics, value_network
from swarmdata.learn.training.settings import LogUniform, Space
from swarmdata.numerics.event_costs import COSTS
from swarmdata.offline_algos.iql import IQL, IQLConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class IQLCostConfig(IQLConfig):
    """Implicit Q-learning with costs; SchemaError if the weight is negative."""

    cost: Literal["all", "robot_collisions", "obstacle_collisions"] = "all"  # `event_costs.COSTS`
    cost_weight: float = 300.0  # lambda; see above

    def __post_init__(self) -> None:
        if not self.cost_weight >= 0:
            raise SchemaError(f"cost_weight is {self.cost_weight}, expected at least 0")


class IQLCost(IQL):
    """`IQL` with critics of costs, trained at once."""

    Config = IQLCostConfig
    FIELDS = (*TRANSITION, "costs")
    LOSSES = (*IQL.LOSSES, "cost_critic_loss", "cost_value_loss", "cost_q")
    SPACE: ClassVar[Space] = {**IQL.SPACE, "cost_weight": LogUniform(10.0, 10_000.0)}

    def __init__(self, setup: Setup, config: IQLCostConfig) -> None:
        super().__init__(setup, config)
        names = COSTS if config.cost == "all" else (config.cost,)
        self._weight, self._columns = config.cost_weight, [COSTS.index(name) for name in names]
        self.cost_critics = robot_critics(setup, config, config.critic, "cost_critics")
        self.cost_value = value_network(setup, self.cost_critics.n_features, config.critic_hidden)
        self.cost_descent = Descent(
            {"cost_value": self.cost_value}, setup.n_seeds, config.critic_learning_rate,
            config.max_grad_norm,
        )  # fmt: skip
        self.parts = (*self.parts, self.cost_critics, self.cost_descent)

    def prefer(
        self, steps: Batch, x: RobotView, actions: Tensor, advantages: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Returns A_i, and moves the critics of costs. As in `IQL`."""
        scale = self.scale
        with torch.no_grad():
            q = self.cost_critics.target_q(x, actions).amax(1)  # [K, R, N]
            y = self.cost_targets(steps)
        excess = q - self.cost_values(x)
        value_loss = agent_mean(excess.square(), steps.alive)  # [K]
        self.cost_descent.step(value_loss, scale)
        q_now = self.cost_critics.q(x, actions).flatten(2)
        critic_loss = td_error(q_now, y.flatten(1), steps.alive)
        self.cost_critics.step(critic_loss, scale)
        self.cost_critics.follow(self.config.tau)
        losses = critic_loss, value_loss, q.mean((1, 2))
        named = dict(zip(self.LOSSES[len(IQL.LOSSES) :], losses, strict=True))
        return advantages - self._weight * excess.detach(), named

    def cost_values(self, x: RobotView) -> Tensor:
        """Returns V^c(x_i), [K, B, N], in events."""
        return self.cost_value(x.rows).view(x.features.shape[:3])

    def cost_targets(self, steps: Batch) -> Tensor:
        """Returns what critics of costs learn, [K, B, N], in events."""
        following = self.cost_values(self.critics.view(steps.next_states, steps.next_observations))
        costs = steps.costs[..., self._columns].sum(-1)
        return td_target(costs, robot_ends(steps), following, self.config.discount)
