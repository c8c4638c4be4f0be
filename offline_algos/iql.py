"""Multi-agent IQL: values of the data's own actions only, then cloning of the better ones.

Implicit Q-learning (Kostrikov, Nair & Levine 2022) with values of each robot: r_i is robot i's own
reward (`reward: team`: the mean over robots), x_i what its critics see, and
q_i = min_j Q'_j(x_i, a),

    L(V)   = mean_i |tau - 1(q_i < V(x_i))| (q_i - V(x_i))^2                          eq. 5
    L(Q_j) = mean_i (r_i + gamma (1 - termination) V(x'_i) - Q_j(x_i, a))^2           eq. 6
    L(pi)  = E_{r ~ w} 1/A |pi(o_i, i) - a_i|^2,  w_r = exp(beta u (q_i - V(x_i)))     eq. 7

E_{r ~ w} is the mean over rows r, of one robot at one step, which are drawn in proportion to their
weights (`objectives.weighted_rows`). Of recorded choices, the actor's loss is the paper's, the
weighted log-likelihood of a categorical policy, which acts by its likeliest choice; critics see
what was chosen as ones among zeros:

    L(pi)  = -E_{r ~ w} log pi(a_i | o_i)                                             eq. 7

No action of a policy ever enters a critic, so nothing outside the data can be overestimated. With
beta 0 all weights are 1: a clone. Critics are `decentralized` (x_i is o_i and the robot's number,
and of a they see a_i) or `centralized` (Lowe et al. 2017, eq. 6; see
`networks.critics`).

u puts beta in the paper's unit: rewards multiplied by 1,000 over the range of undiscounted returns
(the largest of any episode and robot less the smallest; appendix B, for locomotion). The paper has
beta 3 for locomotion and 0.5 for demonstrations (kitchen and adroit). Here beta is
`inverse_temperature` at most, and as much less as keeps `effective_share` of the rows effective.

Deviations:
- The paper has the weights as factors of the loss, and one beta for a dataset.
- Actors are one network for all agents, which sees the agent's number. Those of continuous actions
  are deterministic: the weighted squared error is the paper's weighted log-likelihood for a
  Gaussian of fixed deviation; the paper's Gaussian learns a deviation that does not depend on the
  state, and acts by its mean.
- Critics and value network serve all robots. LayerNorm, normalization and the discount are those of
  `maddpg_bc`, action masks those of `bc`.
- The learning rates of all networks decay along a cosine; in the paper only the actor's.
- With `memory` gru the actors remember; critics and value networks see the present alone.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.interfaces import Policy
from swarmdata.learn.choices.choice_actor import ChoiceActor
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.recurrent_actor import RecurrentActor, make_actor
from swarmdata.learn.networks.actor import StackedActor
from swarmdata.learn.networks.critics import Critic, RobotView
from swarmdata.learn.networks.network_inputs import Reward, RobotRewards
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import cloning_loss, expectile_loss, td_error, td_target
from swarmdata.learn.objectives.weighted_rows import ScoredRows
from swarmdata.learn.policies.trained import policy_of
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    TRANSITION,
    ActorCriticConfig,
    OfflineLearner,
    robot_critics,
    value_network,
)
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch

RANGE = 1_000.0
"""Of returns, in the unit of beta; Kostrikov et al. 2022, appendix B."""


@dataclass(frozen=True)
class IQLConfig(MemorySettings, ActorCriticConfig):
    """Implicit Q-learning of each robot; one setting for all datasets."""

    RETIRED: ClassVar = ("max_weight",)

    expectile: float = 0.7  # tau, Kostrikov et al. 2022, appendix B, for locomotion
    inverse_temperature: float = 3.0  # beta at most, likewise, for returns with a range of 1,000
    effective_share: float = 0.03  # of the rows, see `objectives.weighted_rows`; 1 clones all alike
    critic: Critic = "decentralized"  # see above
    reward: Reward = "own"


class IQL(OfflineLearner):
    """K seeds of actors, two critics and value networks, trained at once."""

    Config = IQLConfig
    FIELDS = TRANSITION
    LOSSES: tuple[str, ...] = (
        "value_loss", "critic_loss", "actor_loss", "q", "advantage_std", "inverse_temperature",
    )  # fmt: skip
    SPACE: ClassVar[Space] = {
        **ACTOR_CRITIC_SPACE,
        "expectile": Choice((0.6, 0.7, 0.8, 0.9)),
        "inverse_temperature": LogUniform(0.1, 30.0),
        "effective_share": Choice((0.03, 0.1, 0.3, 0.7)),
    }

    def __init__(self, setup: Setup, config: IQLConfig) -> None:
        self.config, self.generators = config, setup.generators()
        self.rows = ScoredRows(config.effective_share, self.generators)
        self.actor: StackedActor | RecurrentActor | ChoiceActor
        sizes, hidden, policy_network = setup.sizes, config.actor_hidden, config.policy_network
        if setup.sizes.choices:
            self.actor = ChoiceActor(setup, hidden, config, policy_network=policy_network)
            sizes = self.actor.encoded_sizes
        else:
            self.actor = make_actor(
                setup, hidden, config, squash=True, policy_network=policy_network
            )
        self.rewards = RobotRewards(setup.statistics, config.reward)
        self.critics = robot_critics(replace(setup, sizes=sizes), config, config.critic)
        self.value = value_network(setup, self.critics.n_features, config.critic_hidden)
        self.descent = Descent(
            {"actor": self.actor.network, "value": self.value}, setup.n_seeds,
            {"actor": config.actor_learning_rate, "value": config.critic_learning_rate},
            config.max_grad_norm,
        )  # fmt: skip
        self.parts = (self.descent, self.critics, self.rows)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...], windows with a memory; returns losses, each [K]."""
        config, scale = self.config, self.scale
        steps = self.actor.transitions(batch)  # [K, R, ...]
        actions = steps.actions
        if isinstance(self.actor, ChoiceActor):
            actions = self.actor.encode(actions)
        x = self.critics.view(steps.states, steps.observations)
        with torch.no_grad():
            q = self.critics.target_q(x, actions).amin(1)  # [K, R, N]
        advantages = q - self.values(x)
        alive = self.rewards.learned(steps)
        value_loss = agent_mean(expectile_loss(advantages, config.expectile), alive)  # [K], eq. 5
        y = self.targets(steps)  # of the value network as it was
        self.descent.step_of("value", value_loss, scale)
        q_now = self.critics.q(x, actions).flatten(2)
        critic_loss = td_error(q_now, y.flatten(1), alive)  # eq. 6
        self.critics.step(critic_loss, scale)
        unit = RANGE / self.rewards.return_range
        preferences, reported = self.prefer(steps, x, actions, unit * advantages.detach())
        self.rows.add(batch, preferences, steps.alive)
        actor_loss, beta = self.actor_loss()
        self.descent.step_of("actor", actor_loss, scale)
        self.critics.follow(config.tau)
        self.n_updates += 1
        losses = (value_loss, critic_loss, actor_loss, q.mean((1, 2)), advantages.std((1, 2)), beta)
        named = dict(zip(IQL.LOSSES, losses, strict=True)) | reported
        return {name: loss.detach() for name, loss in named.items()}

    def prefer(
        self, steps: Batch, x: RobotView, actions: Tensor, advantages: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Returns what actors prefer of the data's actions, [K, R, N], and losses, each [K].

        Critics see x of the steps, [K, R, ...], and their actions, [K, R, N, A]. Here actors prefer
        the advantages, u (q_i - V(x_i)), [K, R, N].
        """
        return advantages, {}

    def actor_loss(self) -> tuple[Tensor, Tensor]:
        """Returns the loss of eq. 7 on drawn rows, and beta, both [K]."""
        actions, pi, beta = self.rows.draw(self.actor.along, self.config.inverse_temperature)
        if isinstance(self.actor, ChoiceActor):
            return self.actor.surprise(pi, actions).mean((1, 2)), beta
        return cloning_loss(pi, actions), beta

    def values(self, x: RobotView) -> Tensor:
        """Returns V(x_i), [K, B, N]."""
        return self.value(x.rows).view(x.features.shape[:3])

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y of eq. 6, [K, B, N], in units of scaled rewards."""
        v_next = self.values(self.critics.view(batch.next_states, batch.next_observations))
        ends = self.rewards.ends(batch)
        return td_target(self.rewards(batch.rewards), ends, v_next, self.config.discount)

    def policy(self, index: int) -> Policy:
        return policy_of(self.actor, index)
