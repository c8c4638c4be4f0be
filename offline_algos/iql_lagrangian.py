"""IQL with a Lagrangian: implicit Q-learning that keeps a cost below a budget.

The problem is a constrained Markov decision process (Altman 1999): the most return of all policies
whose episodes cost at most `budget` on average, in contacts of the whole team. `iql` has the
critics of the return; others learn the cost c_i of robot i (`numerics.event_costs`) under the
policy, whose actions are the data's, drawn by the weights w of `iql`. With C = max_j C'_j,

    A_i    = q_i - V(x_i) - lambda (C(x_i, a) - V_c(x_i)),   w = exp(beta u A_i)
    L(C_j) = mean_i (c_i + gamma (1 - termination) V_c(x'_i) - C_j(x_i, a))^2
    L(V_c) = mean_i w (C(x_i, a) - V_c(x_i))^2
    J_c    = H sum_i E [V_c(x_i) - gamma (1 - termination) V_c(x'_i)]

and the actor clones rows drawn by w (eq. 7 of `iql`). lambda is the Lagrange multiplier of the
primal-dual method (Chow et al. 2017, "Risk-constrained reinforcement learning with percentile risk
criteria", section 4), which follows the part by which the budget is exceeded:

    lambda <- max(lambda + rate clip(J_c / budget - 1, -1, 1), 0)

H is the mean length of the data's episodes. In each state that the policy meets, the difference is
its mean cost there (the Bellman equation of V_c), so J_c is the cost of an episode; of the data's
states it is an estimate, and a cautious one by the larger of two critics. As in `iql`, no action of
a policy enters a critic.

Deviations:
- Costs are not scaled: lambda is in standard deviations of the returns-to-go for a contact.
- At least `effective_share` of the rows count: a budget that so many rows cannot keep is exceeded.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.critics import RobotView
from swarmdata.learn.networks.factored_critics import VALUE_STREAM
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import td_error, td_target
from swarmdata.learn.objectives.weighted_rows import row_weights
from swarmdata.learn.training.actor_critic import TRANSITION, Part, robot_critics
from swarmdata.numerics.event_costs import COSTS
from swarmdata.offline_algos.iql import IQL, IQLConfig
from swarmdata.types import Batch


@dataclass(frozen=True)
class IQLLagrangianConfig(IQLConfig):
    """Implicit Q-learning with a budget; one setting for all datasets.

    Raises:
        SchemaError: the budget or the rate is not above 0.
    """

    budget: float = 1.0  # contacts of the team in an episode, on average
    cost: Literal["all", "robot_collisions", "obstacle_collisions"] = "all"
    multiplier_rate: float = 2e-3  # of lambda, per update

    def __post_init__(self) -> None:
        """Checks the numbers."""
        for name in ("budget", "multiplier_rate"):
            if getattr(self, name) <= 0:
                raise SchemaError(f"{name} is {getattr(self, name)}, expected a number above 0")


class IQLLagrangian(IQL):
    """K seeds of implicit Q-learning, each with values of its cost and a multiplier."""

    Config = IQLLagrangianConfig
    FIELDS = (*TRANSITION, "truncations", "costs")
    LOSSES = (*IQL.LOSSES, "cost_loss", "episode_cost", "multiplier")

    def __init__(self, setup: Setup, config: IQLLagrangianConfig) -> None:
        super().__init__(setup, config)
        self.constraint = Constraint(setup, config, self.unit)

    @property
    def parts(self) -> tuple[Part, ...]:
        return *super().parts, self.constraint

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step, as of `iql`; returns losses, each [K].

        Raises:
            SchemaError: the batch has no costs.
        """
        if batch.costs is None:
            raise SchemaError(
                "a batch for iql_lagrangian has no costs, since no events were recorded in these "
                "data; take a dataset of one of the tasks, or iql"
            )
        return super().update(batch) | self.constraint.reported

    def ranked(self, steps: Batch, x: RobotView, advantages: Tensor) -> Tensor:
        """Returns A_i, [K, R, N]; moves the values of the cost and the multiplier."""
        x_next = self.critics.view(steps.next_states, steps.next_observations)
        return self.constraint.update(steps, x, x_next, advantages, self.scale)


class Constraint:
    """Values of the cost of K seeds, and multipliers.

    Attributes:
        multiplier: lambda, [K].
        reported: of the last update, each [K].

    Args:
        setup: sizes and seeds.
        config: settings.
        unit: u, of advantages.
    """

    def __init__(self, setup: Setup, config: IQLLagrangianConfig, unit: float) -> None:
        self.config, self.unit = config, unit
        self.critics = robot_critics(setup, config, config.critic)
        shape = MLPShape(self.critics.n_features, config.critic_hidden, 1, layer_norm=True)
        self.value = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.value, setup.seeds, VALUE_STREAM)
        self.adam = StackedAdam(
            self.value, setup.n_seeds, config.critic_learning_rate, config.max_grad_norm
        )
        self.is_counted = [config.cost in (name, "all") for name in COSTS]
        self.multiplier = torch.zeros(setup.n_seeds, device=setup.device)
        self.counts = torch.zeros(2, setup.n_seeds, device=setup.device)  # steps, ends of episodes
        self.reported: dict[str, Tensor] = {}

    def update(
        self, steps: Batch, x: RobotView, x_next: RobotView, advantages: Tensor, scale: float
    ) -> Tensor:
        """Moves values and multipliers; returns A_i, [K, R, N].

        Args:
            steps: transitions, [K, R, ...].
            x: what the critics see of them.
            x_next: of the states reached.
            advantages: q_i - V(x_i), [K, R, N].
            scale: factor on the learning rate.
        """
        config = self.config
        costs = steps.costs[..., self.is_counted].sum(-1)  # [K, R, N]
        with torch.no_grad():
            larger = self.critics.target_q(x, steps.actions).amax(1)
            later = self.values(x_next)
        y = td_target(costs, steps.terminations[..., None], later, config.discount)
        values = self.values(x)
        combined = advantages - self.multiplier[:, None, None] * (larger - values.detach())
        weights, _ = row_weights(
            self.unit * combined, config.inverse_temperature, config.effective_share
        )
        weights = weights / weights.mean((1, 2), keepdim=True)
        value_loss = (weights * (larger - values).square()).mean((1, 2))
        self.adam.step(value_loss, scale)
        loss = td_error(self.critics.q(x, steps.actions).flatten(2), y.flatten(1))
        self.critics.step(loss, scale)
        self.critics.follow(config.tau)
        per_step = values.detach() - (y - costs)  # a robot's; y - c is the discounted rest
        episode_cost = self._follow(steps, per_step.sum(2).mean(1))
        self.reported = {
            "cost_loss": loss.detach(),
            "episode_cost": episode_cost,
            "multiplier": self.multiplier.clone(),
        }
        return combined

    def values(self, x: RobotView) -> Tensor:
        """Returns V_c(x_i), [K, R, N]."""
        return self.value(x.rows).view(x.features.shape[:3])

    def _follow(self, steps: Batch, per_step: Tensor) -> Tensor:
        """Moves the multipliers by J_c, which it returns, [K], given J_c / H, [K]."""
        config, ends = self.config, steps.terminations | steps.truncations
        self.counts[0] += ends.shape[1]
        self.counts[1] += ends.sum(1)
        length = self.counts[0] / self.counts[1].clamp(min=1.0)
        cost: Tensor = length * per_step
        step = (cost / config.budget - 1).clamp(-1, 1)
        self.multiplier = (self.multiplier + config.multiplier_rate * step).clamp(min=0.0)
        return cost

    def state_dict(self) -> dict[str, Tensor]:
        """Networks, Adam's moments, multipliers and counts, as copies."""
        state = {"value": self.value.flat.clone(), **self.adam.state_dict("value_adam.")}
        state |= {"multiplier": self.multiplier.clone(), "counts": self.counts.clone()}
        state |= self.critics.state_dict()
        return {f"cost_{name}": value for name, value in state.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        own = {k.removeprefix("cost_"): v for k, v in state.items() if k.startswith("cost_")}
        self.critics.load_state_dict(own)
        self.value.load(own["value"])
        self.adam.load_state_dict(own, "value_adam.")
        self.multiplier, self.counts = own["multiplier"].clone(), own["counts"].clone()
