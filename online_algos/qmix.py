"""QMIX: the team's value is a monotonic function of its robots' values.

Rashid et al., "QMIX: monotonic value function factorisation for deep multi-agent reinforcement
learning", ICML 2018, equations 5 and 6, over choices among bins of each action dimension
(`learn.choices.bins`), trained by double Q-learning (van Hasselt et al. 2016, equation 4):

    Q_tot(x, u) = f(Q_1(o_1, u_1), ..., Q_N(o_N, u_N); x)         dQ_tot / dQ_i >= 0
    u'_i  = argmax_u Q_i(o'_i, u)                          chosen by the online networks
    y     = r + gamma (1 - termination) Q'_tot(x', u')              valued by the targets
    L     = Huber(Q_tot(x, u) - y)

Q_i is the mean over action dimensions, f is `mixers.MonotonicMixer`, and x = (state, all
observations). Without the mixing network it is `online_algos.vdn`.

Deviations:
- The hypernetwork sees x, the paper's the state alone, which says nothing of obstacles here
  (`network_inputs.information`).
- One hypernetwork with a hidden layer gives all weights and biases of the mixing network; in the
  paper they are separate, and the weights are linear in the state.
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
from swarmdata.learn.networks.mixers import MonotonicMixer
from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.training.exploration import LinearSchedule
from swarmdata.online_algos.collection import value_learning
from swarmdata.online_algos.collection.replay_collection import Collector, Plan
from swarmdata.online_algos.collection.value_learning import (
    LOSSES,
    MIXER_STREAM,
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
class QMIXConfig(ValueLearningConfig):
    """Settings of QMIX: those of every value decomposition, and of the mixer."""

    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64
    exploration: float = 0.05  # less than VDN, whose values do not diverge: docs/online-learning.md


class QMIXLearner:
    """K seeds of utility networks and a mixer, trained on batches of bins.

    A discrete action space is the case of one dimension: with `sizes.action` 1 there are `n_bins`
    actions to choose from.

    Args:
        sizes: numbers of robots and features; `action` is the number of choices to make.
        seeds: of the initial parameters, [K].
        config: settings.
    """

    utilities, update = utilities_of, td_update

    def __init__(self, sizes: Sizes, seeds: Sequence[int], config: QMIXConfig) -> None:
        self.config = config
        self.team = utility_team(sizes, seeds, config)
        self.mixer = MonotonicMixer(
            sizes.n_agents, sizes.information, seeds, MIXER_STREAM,
            embedding=config.mixer_embedding, hidden=config.mixer_hidden, device="cpu",
            n_critics=config.n_critics,
        )  # fmt: skip
        networks = {"team": self.team.network, "mixer": self.mixer.network}
        self.descent = Descent(
            networks, len(seeds), config.learning_rate, config.max_grad_norm, followed=networks
        )

    def value(self, features: Tensor, states: Tensor, places: Tensor) -> Tensor:
        """Returns Q_tot of each critic, [K, J, B], of places among bins [K, B, N, D].

        Args:
            features: normalized observations, [K, B, N, O].
            states: normalized, [K, B, S].
            places: `bins.places`; whole numbers are bins.
        """
        utilities = self.utilities(features)
        values = bins.interpolated(utilities, by_critic(places, utilities))  # [K, J, B, N]
        return self._mix(values, information(states, features))

    def _mix(self, values: Tensor, x: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns team values, [K, J, B], of robots' values [K, J, B, N] and x, [K, B, X]."""
        k, n_critics = values.shape[:2]
        mixed = self.mixer(values.flatten(0, 1), x.repeat_interleave(n_critics, 0), network)
        return mixed.view(k, n_critics, -1)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        o_next, slow = batch.next_observations, self.descent.targets
        choices = greedy_choices(self.utilities(o_next))
        utilities = self.utilities(o_next, slow["team"])
        values = bins.chosen(utilities, by_critic(choices, utilities))  # [K, J, B, N]
        x_next = information(batch.next_states, o_next)
        q_next = self._mix(values, x_next, slow["mixer"]).mean(1)  # [K, B]
        r = team_reward(batch.rewards) * self.config.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)


class QMIX:
    """K seeds of QMIX in K E copies of a task, with their replay in a folder."""

    Config = QMIXConfig
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
        self, env: VecEnv, seeds: Sequence[int], config: QMIXConfig, folder: Path | str
    ) -> None:
        self.collector = Collector(env, seeds, Plan.of(config), folder)
        self.learner = QMIXLearner(self.collector.sizes, seeds, config)
        self.schedule = LinearSchedule(config.epsilon, config.final_epsilon, config.exploration)

    @property
    def frames(self) -> int:
        """Joint steps that each seed has taken."""
        return self.collector.frames
