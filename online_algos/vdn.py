"""VDN: the team's value is the mean of its robots' values, which see what the robots see.

Sunehag et al., "Value-decomposition networks for cooperative multi-agent learning", AAMAS 2018,
section 3, over choices among bins of each action dimension (`learn.choices.bins`), trained by
double Q-learning (van Hasselt et al. 2016, equation 4):

    Q_tot(o, u) = 1/N sum_i Q_i(o_i, u_i)      Q_i(o_i, u_i) = 1/D sum_d U_d(o_i, u_id)
    u'_i  = argmax_u Q_i(o'_i, u)                          chosen by the online networks
    y     = r + gamma (1 - termination) Q'_tot(o', u')     valued by the targets
    L     = Huber(Q_tot(o, u) - y)

Deviations:
- The mean over robots instead of the sum: the team reward is a mean too, so that values keep their
  scale in teams of any size. The greedy choices are the same.
- Feed-forward networks, no recurrent ones: observations hold velocities.
- Single transitions from many copies instead of whole episodes; slowly moving targets instead of
  hard copies; Huber loss; actions and observations turned to the robot's target (`frame`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from swarmdata.interfaces import VecEnv
from swarmdata.learn.choices import bins
from swarmdata.learn.networks.descent import Descent
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.training.exploration import LinearSchedule
from swarmdata.online_algos.collection import value_learning
from swarmdata.online_algos.collection.replay_collection import Collector, Plan
from swarmdata.online_algos.collection.value_learning import (
    LOSSES,
    ValueLearningConfig,
    by_critic,
    greedy_choices,
    td_update,
    utilities_of,
    utility_team,
)
from swarmdata.online_algos.continuation.started_utilities import settings_of, start_from
from swarmdata.types import Batch


@dataclass(frozen=True)
class VDNConfig(ValueLearningConfig):
    """Settings of VDN: those of every value decomposition."""


class VDNLearner:
    """K seeds of utility networks, trained on batches of bins.

    A discrete action space is the case of one dimension: with `sizes.action` 1 there are `n_bins`
    actions to choose from.

    Args:
        sizes: numbers of robots and features; `action` is the number of choices to make.
        seeds: of the initial parameters, [K].
        config: settings.
    """

    utilities, update = utilities_of, td_update

    def __init__(self, sizes: Sizes, seeds: Sequence[int], config: VDNConfig) -> None:
        self.config = config
        self.team = utility_team(sizes, seeds, config)
        self.descent = Descent(
            {"team": self.team.network}, len(seeds), config.learning_rate, config.max_grad_norm,
            followed=("team",),
        )  # fmt: skip

    def value(self, features: Tensor, states: Tensor, places: Tensor) -> Tensor:
        """Returns Q_tot of each critic, [K, J, B], of places among bins [K, B, N, D]."""
        utilities = self.utilities(features)
        return bins.interpolated(utilities, by_critic(places, utilities)).mean(-1)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        o_next, target = batch.next_observations, self.descent.targets["team"]
        choices = greedy_choices(self.utilities(o_next))
        utilities = self.utilities(o_next, target)
        q_next = bins.chosen(utilities, by_critic(choices, utilities)).mean(-1).mean(1)  # [K, B]
        r = team_reward(batch.rewards) * self.config.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)


class VDN:
    """K seeds of VDN in K E copies of a task, with their replay in a folder."""

    Config = VDNConfig
    LOSSES = (*LOSSES, "reward")

    update = value_learning.update_round
    policy = value_learning.policy_of
    prepare = value_learning.skip_preparation
    mix_in = value_learning.mix_in
    settings_of, start_from = staticmethod(settings_of), start_from
    restart_worlds = value_learning.restart_worlds
    state_dict = value_learning.state_of
    load_state_dict = value_learning.restore_state

    def __init__(
        self, env: VecEnv, seeds: Sequence[int], config: VDNConfig, folder: Path | str
    ) -> None:
        self.collector = Collector(env, seeds, Plan.of(config), folder)
        self.learner = VDNLearner(self.collector.sizes, seeds, config)
        self.schedule = LinearSchedule(config.epsilon, config.final_epsilon, config.exploration)

    @property
    def frames(self) -> int:
        """Joint steps that each seed has taken."""
        return self.collector.frames
