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

The `regulariser` gives the rule and the loss that is added to L_td:

    none  double Q-learning, which overestimates what the data lack; plain without `clip_target`
    bc    choose, and bootstrap, by argmax U / temperature + log pi_b
    bcq   only choices with pi_b >= threshold max pi_b, in the target and when acting
    cql   push down all choices together, and the data's up

The rule is `behavior_heads.Rule`, and the policy acts by the same rule: a mask that is only in the
target lets the policy take what was never valued (as OG-MARL's `qmix_bcq` does). That the online
networks choose and the targets value is double Q-learning (van Hasselt et al. 2016, equation 4).

R* is the largest discounted return-to-go of the dataset (`clip_target`, as `maddpg_bc` has it).
Without it the weights of QMIX's mixer and its values drive each other up: on random choices in
`simple_spread_v3` values rose above 0, where every return is negative, and the policies earned less
than the data. With it they earn more (tests/record/test_playing_choices.py).

`temperature` and `cql_weight` (alpha) are in units of scaled rewards; Beeson et al. have 1 and 0.25
in raw ones. A smaller temperature gains on mixed data and loses on expert data; the default is a
compromise, chosen on version 0 of `coop_nav`, and so is alpha.

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
- Recorded continuous actions are interpolated between bins, not moved to the nearest one.
- Feed-forward networks, as observations hold velocities; with `memory` gru, one gated unit of a
  seed remembers for all its networks, and the targets have a slow copy of it. Slowly moving
  targets, Huber loss, LayerNorm in the utility networks, a cosine of learning rates. Observations
  are normalized with the dataset's statistics, rewards divided by the deviation of returns-to-go.
- Recorded action masks hold when acting (`swarmdata.evaluate_parallel`); batches do not have them,
  so that targets may value forbidden choices, which `bc` and `bcq` leave out as nobody took them.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.choices.utility_networks import (
    LOSSES,
    DecompositionConfig,
    Seen,
    UtilityNetworks,
    policy_of,
    regularised_update,
    restore_state,
    state_of,
)
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.objectives.value_losses import robot_values
from swarmdata.learn.training.setup import Setup


@dataclass(frozen=True)
class VDNConfig(DecompositionConfig):
    """Settings of offline VDN: those of every value decomposition."""


class VDN:
    """K seeds of offline VDN, trained at once."""

    Config = VDNConfig
    LOSSES = LOSSES

    update, policy = regularised_update, policy_of
    state_dict, load_state_dict = state_of, restore_state

    def __init__(self, setup: Setup, config: VDNConfig) -> None:
        self.config, self.n_updates = config, 0
        self.networks = UtilityNetworks(setup, config)

    def value(self, utilities: Tensor, weights: Tensor, x: Tensor) -> Tensor:
        """Returns Q_j(o, a), [K, J, B], equation 1, which has no use for x.

        Args:
            utilities: [K, J, B, N, D, C].
            weights: the actions as weights of the choices, [K, B, N, D, C].
            x: state and all observations, [K, B, S + N O].
        """
        return robot_values(utilities, weights).mean(-1)

    @torch.no_grad()
    def targets(self, seen: Seen) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        networks = self.networks
        batch, features = seen.batch, seen.next_features
        a_next = networks.act(networks.utilities(features), networks.log_probs(features))
        utilities = networks.utilities(seen.slow_next_features, networks.descent.targets["team"])
        x_next = networks.information(batch.next_states, features)
        q_next = self.value(utilities, a_next, x_next).mean(1)  # [K, B]
        q_next = q_next.clamp(max=networks.normalizer.max_value)
        r = team_reward(batch.rewards) * networks.normalizer.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)
