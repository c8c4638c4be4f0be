"""IQL-Lagrangian: implicit Q-learning that keeps the expected cost of an episode within a budget.

A constrained Markov decision process (Altman 1999, "Constrained Markov Decision Processes") has
beside rewards r_i costs c_i of each robot, such as collisions, and a budget d of their sum over
robots and an episode. The policy that is sought is the best among those that keep it. By the
Lagrangian, it prefers actions by their rewards less lambda times their costs. With the notation of
`offline_algos.iql`, advantages of costs in events, and q^c_i = max_j Q^c'_j(x_i, a):

    A_i      = u (q_i - V(x_i)) - lambda (q^c_i - V^c(x_i)),  w_r as `weighted_rows` of A
    L(Q^c_j) = mean_i (c_i + gamma (1 - termination) V^c(x'_i) - Q^c_j(x_i, a))^2
    L(V^c)   = sum_r w_r (q^c_r - V^c(x_r))^2 / sum_r w_r
    J        = T (1 - gamma) E_x sum_i V^c(x_i)
    lambda  <- lambda exp(eta (J - d) / (J + d)),  1 <= lambda <= 10,000

The weights are those with which the actor clones, so V^c is the cost of the policy that is
extracted, and not of the data; no action of a policy enters a critic here either. J estimates its
cost in an episode of T steps, the mean length of the data's, from states of the data: with
V^c(x) the discounted cost from x, (1 - gamma) V^c(x) is its mean cost per step. Budgets are
converted alike, from a sum over T steps to a discounted one, by BCQ-Lag and CPQ as Liu et al. 2023
run them ("Datasets and benchmarks for offline safe reinforcement learning", arXiv 2306.09303).
lambda says how many thousandths of the range of returns a contact costs.

Deviations:
- Papers on a Lagrangian (Stooke et al. 2020, "Responsive safety in reinforcement learning by PID
  Lagrangian methods") step lambda by J - d; the relative step needs no unit of costs, and lets
  lambda fall as well where the budget is 0.
- J is of states of the data. A policy that goes where the data seldom are has another cost, so the
  budget has to be checked in the simulator.
- A robot's cost of a collision with another robot is half of it, the other half being that of the
  other robot; both prefer to avoid it alike.
- All others of `offline_algos.iql`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.critics import RobotView
from swarmdata.learn.networks.factored_critics import VALUE_STREAM
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import td_error, td_target
from swarmdata.learn.objectives.weighted_rows import row_weights
from swarmdata.learn.training.actor_critic import TRANSITION, Part, robot_critics
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.numerics.event_costs import COSTS
from swarmdata.offline_algos.iql import IQL, IQLConfig
from swarmdata.types import Batch

SMALLEST_WEIGHT, LARGEST_WEIGHT = 1.0, 10_000.0
"""Of a cost, lambda, in thousandths of the range of returns."""


@dataclass(frozen=True)
class IQLLagConfig(IQLConfig):
    """Implicit Q-learning within a budget of costs.

    Raises:
        SchemaError: the budget is negative, or lambda does not move.
    """

    cost: Literal["all", "robot_collisions", "obstacle_collisions"] = "all"  # `event_costs.COSTS`
    budget: float = 0.1  # d, of the team in an episode: at most one contact in ten episodes
    multiplier: float = 10.0  # lambda at first
    multiplier_rate: float = 0.005  # eta

    def __post_init__(self) -> None:
        if not self.budget >= 0 or not self.multiplier_rate > 0:
            raise SchemaError(
                f"budget is {self.budget} and multiplier_rate {self.multiplier_rate}, expected a "
                "budget of at least 0 and a rate above 0"
            )
        if not SMALLEST_WEIGHT <= self.multiplier <= LARGEST_WEIGHT:
            raise SchemaError(
                f"multiplier is {self.multiplier}, expected {SMALLEST_WEIGHT:g} to "
                f"{LARGEST_WEIGHT:g}"
            )


class Multiplier:
    """The weights of costs of K seeds, lambda, which follow how much their budget is exceeded.

    Args:
        first: at first.
        rate: eta.
        setup: of the algorithm.
    """

    def __init__(self, first: float, rate: float, setup: Setup) -> None:
        self._rate = rate
        self.value = torch.full((setup.n_seeds,), first, device=setup.device)  # [K]

    def step(self, costs: Tensor, budget: float) -> None:
        """Raises the weights where costs [K] are above the budget, and lowers them elsewhere."""
        excess = (costs - budget) / (costs + budget).clamp(min=1e-9)
        moved = self.value * (self._rate * excess).exp()
        self.value = moved.clamp(SMALLEST_WEIGHT, LARGEST_WEIGHT)

    def state_dict(self) -> dict[str, Tensor]:
        return {"multiplier": self.value.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.value = state["multiplier"].to(self.value.device, copy=True)


class IQLLag(IQL):
    """`IQL` with critics of costs, trained at once."""

    Config = IQLLagConfig
    FIELDS = (*TRANSITION, "costs")
    LOSSES = (*IQL.LOSSES, "cost_critic_loss", "cost_value_loss", "episode_cost", "multiplier")
    SPACE: ClassVar[Space] = {
        **IQL.SPACE,
        "multiplier": Choice((1.0, 10.0, 100.0)),
        "multiplier_rate": LogUniform(1e-3, 2e-2),
    }

    def __init__(self, setup: Setup, config: IQLLagConfig) -> None:
        super().__init__(setup, config)
        self.config: IQLLagConfig = config
        self._columns = list(range(len(COSTS))) if config.cost == "all" else [COSTS.index(config.cost)]
        self._episode_length = setup.statistics.episode_length
        self.cost_critics = robot_critics(setup, config, config.critic, "cost_critics")
        shape = MLPShape(self.cost_critics.n_features, config.critic_hidden, 1, layer_norm=True)
        self.cost_value = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.cost_value, setup.seeds, VALUE_STREAM)
        self.cost_descent = Descent(
            {"cost_value": self.cost_value}, setup.n_seeds, config.critic_learning_rate,
            config.max_grad_norm,
        )  # fmt: skip
        self.multiplier = Multiplier(config.multiplier, config.multiplier_rate, setup)

    @property
    def parts(self) -> tuple[Part, ...]:
        return *super().parts, self.cost_critics, self.cost_descent, self.multiplier

    def prefer(
        self, steps: Batch, x: RobotView, actions: Tensor, advantages: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Returns A_i; moves the critics of costs and lambda. As in `IQL`."""
        config = self.config
        values = self.cost_values(x)  # [K, R, N]
        with torch.no_grad():
            cost_q = self.cost_critics.target_q(x, actions).amax(1)
            y = self.cost_targets(steps)
        weight = self.multiplier.value[:, None, None]
        preferences = advantages - weight * (cost_q - values.detach())
        w, _ = row_weights(preferences, config.inverse_temperature, config.effective_share)
        value_loss = (w * (cost_q - values).square()).mean((1, 2)) / w.mean((1, 2))
        self.cost_descent.step(value_loss, self.scale)
        critic_loss = td_error(self.cost_critics.q(x, actions).flatten(2), y.flatten(1))
        self.cost_critics.step(critic_loss, self.scale)
        self.cost_critics.follow(config.tau)
        costs = self.episode_cost(values.detach())
        self.multiplier.step(costs, config.budget)
        losses = critic_loss, value_loss, costs, self.multiplier.value
        return preferences, dict(zip(self.LOSSES[len(IQL.LOSSES) :], losses, strict=True))

    def cost_values(self, x: RobotView) -> Tensor:
        """Returns V^c(x_i), [K, B, N], in events."""
        return self.cost_value(x.rows).view(x.features.shape[:3])

    def cost_targets(self, steps: Batch) -> Tensor:
        """Returns what critics of costs learn, [K, B, N], in events."""
        following = self.cost_values(self.critics.view(steps.next_states, steps.next_observations))
        ends = steps.terminations[..., None]
        costs = steps.costs[..., self._columns].sum(-1)
        return td_target(costs, ends, following, self.config.discount)

    def episode_cost(self, values: Tensor) -> Tensor:
        """Returns J, [K], of values V^c(x_i) [K, B, N]."""
        per_step = (1 - self.config.discount) * values.sum(2).mean(1)
        return self._episode_length * per_step.clamp(min=0)
