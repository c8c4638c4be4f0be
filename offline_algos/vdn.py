"""Offline VDN: the team's value is the mean of its robots' values, kept near the data.

Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
equation 1, over choices: recorded ones, or bins of each column of continuous actions (DecQN, Seyde
et al. 2023; offline: Beeson, Ireland & Montana, "An investigation of offline reinforcement learning
in factorisable action spaces", TMLR 2024). Robot i sees o_i; column d of its action has C choices
with utilities U_j(o_i)_dk of two networks j. A recorded action a is a weight w_k(a_id) of each
choice: 1 and 0 of recorded choices, the linear interpolation of the two nearest bins of continuous
actions. With team reward r, the mean over robots:

    Q_j(o_i, a_i) = 1/D sum_dk w_k(a_id) U_j(o_i)_dk              (Seyde et al. 2023, equation 2)
    Q_j(o, a)     = 1/N sum_i Q_j(o_i, a_i)                       (Sunehag et al. 2018, equation 1)
    a'_i  = rule(1/2 sum_j U_j(o'_i), pi_b(. | o'_i))             chosen by the online networks
    y     = r + gamma (1 - termination) min(1/2 sum_j Q'_j(o', a'), R*)     valued by the targets
    L_td  = sum_j Huber(Q_j(o, a) - y)
    L_b   = -sum_id sum_k w_k(a_id) log pi_b(k | o_i)_d / N       with `bc` and `bcq`
    L_cql = alpha sum_j mean_id [log sum_k exp U_j(o_i)_dk - sum_k w_k(a_id) U_j(o_i)_dk]

With `independent` there is no sum: each robot learns the value of its own reward r_i, which is
independent Q-learning (Tan, "Multi-agent reinforcement learning: independent vs.
cooperative agents", ICML 1993) with the same choices, rule and losses:

    y_i   = r_i + gamma (1 - termination) min(1/2 sum_j Q'_j(o'_i, a'_i), R*)
    L_td  = sum_j 1/N sum_i Huber(Q_j(o_i, a_i) - y_i)

The `regulariser` gives the rule and the loss that is added to L_td:

    none  double Q-learning, which overestimates what the data lack; plain without `clip_target`
    bc    choose, and bootstrap, by argmax U / temperature + log pi_b
    bcq   only choices with pi_b >= threshold max pi_b, in the target and when acting
    cql   push down all choices together, and the data's up

The rule is `behavior_heads.Rule`, and the policy acts by the same rule: a mask that is only in the
target lets the policy take what was never valued (as OG-MARL's `qmix_bcq` does). That the online
networks choose and the targets value is double Q-learning (van Hasselt et al. 2016, equation 4).

R* is the largest discounted return-to-go of the dataset (`clip_target`, as `maddpg_bc` has it).
Without it the weights of QMIX's mixer and its values drive each other up
(tests/record/test_playing_choices.py).

`temperature` and `cql_weight` (alpha) are in units of scaled rewards; Beeson et al. have 1 and 0.25
in raw ones. A smaller temperature gains on mixed data and loses on expert data.

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
- Recorded continuous actions are interpolated between bins, not moved to the nearest one.
- With `memory` gru, one gated unit of a seed remembers for all its networks, and the targets have a
  slow copy of it. Slowly moving targets, Huber loss, LayerNorm, cosines and normalization.
- Recorded action masks hold when acting (`swarmdata.evaluate_parallel`); batches do not have them,
  so that targets may value forbidden choices, which `bc` and `bcq` leave out as nobody took them.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from swarmdata.learn.choices.utility_networks import DecompositionConfig, Seen, UtilityNetworks
from swarmdata.learn.networks.network_inputs import Reward
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.presence import agent_mean, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import (
    Loss,
    behavior_loss,
    conservative_gap,
    huber_error,
    robot_values,
    td_target,
    team_reward,
)
from swarmdata.learn.policies.choice_policy import ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.policies.trained import utility_policy
from swarmdata.learn.training.actor_critic import TRANSITION, OfflineLearner
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch

GREEDY_EVERY = 10
"""Updates between two measurements of `greedy_q`, which nothing learns from."""


@dataclass(frozen=True)
class VDNConfig(DecompositionConfig):
    """Settings of offline VDN: those of every value decomposition, and whether there is a sum."""

    independent: bool = False  # values of own rewards, without a sum

    @property
    def reward(self) -> Reward:
        return "own" if self.independent else "team"


class VDN(OfflineLearner):
    """K seeds of offline VDN, trained at once."""

    Config: type[DecompositionConfig] = VDNConfig
    FIELDS = TRANSITION
    LOSSES = ("td_loss", "q", "greedy_q", "target", "behavior_loss", "conservative_gap")
    """`greedy_q` is the online value of what the policy would choose: where it leaves `q`, the
    value of the data's actions, and both leave what the data return, values are overestimated."""
    SPACE: ClassVar[Space] = {
        "learning_rate": LogUniform(3e-4, 1e-2),
        "discount": Choice((0.9, 0.95, 0.98)),
        "tau": LogUniform(3e-3, 0.1),
        "regulariser": Choice(("bc", "bcq", "cql")),
        "temperature": LogUniform(0.05, 5.0),
        "threshold": Choice((0.2, 0.5, 0.8)),
        "cql_weight": LogUniform(1e-2, 1.0),
    }

    def __init__(
        self, setup: Setup, config: DecompositionConfig, mixer: StackedMLP | None = None
    ) -> None:
        self.config = config
        self.networks = UtilityNetworks(setup, config, mixer)
        self.parts = (self.networks,)

    def update(self, batch: Batch) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...], windows with a memory; returns losses [K].

        Losses that the regulariser does not have are left out.
        """
        networks = self.networks
        seen = networks.see(batch)
        y = self.targets(seen)
        utilities, log_probs = networks.utilities(seen.features), networks.log_probs(seen.features)
        weights = networks.choices.weights(seen.batch.actions)
        x = networks.information(seen.batch.states, seen.features)
        alive = seen.batch.alive
        q = self.value(utilities, weights, x, alive)  # [K, J, B]
        total, reported = self.loss(q, y, utilities, weights, log_probs, alive)
        if self.n_updates % GREEDY_EVERY == 0:
            with torch.no_grad():
                values = self.value(utilities, networks.act(utilities, log_probs), x, alive)
            reported["greedy_q"] = agent_mean(values, None)
        networks.descent.step(total, self.scale)
        networks.descent.follow(self.config.tau)
        self.n_updates += 1
        return {name: loss.detach() for name, loss in reported.items()}

    def loss(
        self, q: Tensor, y: Tensor, utilities: Tensor, weights: Tensor, log_probs: Tensor | None,
        alive: Tensor | None,
    ) -> Loss:  # fmt: skip
        """Returns L_td, with L_b of `bc` and `bcq` or L_cql of `cql`, [K].

        Values q and targets y are as `value` and `targets` return them.
        """
        config = self.config
        learned = alive if config.reward == "own" else None
        td_loss = huber_error(q.flatten(2), y.flatten(1), learned)  # [K]
        reported = {"td_loss": td_loss, "q": agent_mean(q, None), "target": agent_mean(y, None)}
        if log_probs is not None:
            loss = behavior_loss(log_probs, weights, config.behavior_head, alive)  # [K]
            return Loss(td_loss + loss, reported | {"behavior_loss": loss})
        if config.regulariser == "cql":
            exists = self.networks.choices.exists
            gap = conservative_gap(utilities, weights, exists, alive)  # [K]
            return Loss(td_loss + config.cql_weight * gap, reported | {"conservative_gap": gap})
        return Loss(td_loss, reported)

    def value(
        self, utilities: Tensor, weights: Tensor, x: Tensor, alive: Tensor | None,
        mixer: StackedMLP | None = None,
    ) -> Tensor:  # fmt: skip
        """Returns the team's Q_j, [K, J, B], or those of robots, [K, J, B, N], without a sum.

        Robots that have left are worth 0.

        Utilities are [K, J, B, N, D, C], weights of the choices [K, B, N, D, C], x [K, B, S + N O];
        `alive` is as in `presence`, `mixer` a slow copy of the mixer's networks.
        """
        values = robot_values(utilities, weights)  # [K, J, B, N]
        values = values if alive is None else values * alive[:, None]
        return values if self.config.reward == "own" else self.mix(values, x, mixer)

    def mix(self, values: Tensor, x: Tensor, mixer: StackedMLP | None = None) -> Tensor:
        """Returns the mean of robots' values, [K, J, B] of [K, J, B, N], equation 1."""
        return values.mean(-1)

    @torch.no_grad()
    def targets(self, seen: Seen) -> Tensor:
        """Returns y, [K, B], or that of each robot, [K, B, N], in units of scaled rewards."""
        networks, slow = self.networks, self.networks.descent.targets
        batch, features = seen.batch, seen.next_features
        a_next = networks.act(networks.utilities(features), networks.log_probs(features))
        utilities = networks.utilities(seen.slow_next_features, slow["team"])
        x_next = networks.information(batch.next_states, features)
        q_next = self.value(utilities, a_next, x_next, going_on(batch), slow.get("mixer"))
        rewards = networks.rewards
        q_next = q_next.mean(1).clamp(max=rewards.max_value)
        if self.config.reward == "own":
            r = rewards(batch.rewards)
            return td_target(r, rewards.ends(batch), q_next, self.config.discount)
        r = team_reward(batch.rewards) * rewards.scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def policy(self, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
        return utility_policy(self.networks, index)
