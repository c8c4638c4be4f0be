"""Value decomposition: utilities of each robot's choices, trained through a mixer.

With Q_i the mean over action dimensions of robot i's utilities (`learn.bins`), and a mixer f:

    Q_tot(s, o, u) = f(Q_1(o_1, u_1), ..., Q_N(o_N, u_N); s)
    u'_i  = argmax_u Q_i(o'_i, u)                          chosen by the online networks
    y     = r + gamma (1 - termination) Q'_tot(s', o', u')          valued by the targets
    L     = Huber(Q_tot(s, o, u) - y)

That the online networks choose and the targets value is double Q-learning (van Hasselt et al. 2016,
equation 4). Every dimension is a choice, so a discrete action space is the case of one dimension.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.choices import bins
from swarmdata.learn.networks.descent import Descent
from swarmdata.learn.networks.mixers import Mixer
from swarmdata.learn.networks.perceptrons import StackedMLP
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.types import Batch

LOSSES = ("td_loss", "q", "target")


@dataclass(frozen=True, slots=True)
class Rates:
    """Hyperparameters of a decomposed learner."""

    discount: float
    reward_scale: float
    step_size: float
    polyak: float  # per update
    max_gradient_norm: float | None  # per seed, of each network kind


class Decomposition:
    """K seeds of utility networks and a mixer, trained on batches of choices.

    Args:
        team: utility networks whose outputs are D C utilities.
        mixer: makes a team's value of its robots' values.
        n_seeds: K.
        n_choices: in each dimension, C.
        rates: hyperparameters.
    """

    def __init__(
        self, team: Team, mixer: Mixer, n_seeds: int, n_choices: int, rates: Rates
    ) -> None:
        self.team, self.mixer, self.n_choices, self.rates = team, mixer, n_choices, rates
        networks = {"team": team.network}
        if mixer.network is not None:
            networks["mixer"] = mixer.network
        self.descent = Descent(
            networks, n_seeds, rates.step_size, rates.max_gradient_norm, followed=networks
        )

    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns the utility of every choice, [K, B, N, D, C].

        Args:
            features: normalized observations, [K, B, N, F].
            network: other parameters to use, those of the targets.
        """
        return bins.by_dimension(self.team(features, network), self.n_choices)

    def value(self, features: Tensor, states: Tensor, choices: Tensor) -> Tensor:
        """Returns Q_tot, [K, B], of choices [K, B, N, D]; states are normalized, [K, B, S]."""
        return self.mixer(bins.chosen(self.utilities(features), choices), states)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        choices = bins.greedy(self.utilities(batch.next_observations))
        targets = self.descent.targets
        utilities = self.utilities(batch.next_observations, targets["team"])
        values = bins.chosen(utilities, choices)
        q_next = self.mixer(values, batch.next_states, targets.get("mixer"))
        r = team_reward(batch.rewards) * self.rates.reward_scale
        return td_target(r, batch.terminations, q_next, self.rates.discount)

    def update(self, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...]; returns losses, each [K].

        Args:
            batch: normalized observations and states, choices as actions.
            scale: factor on the step size.
        """
        y = self.targets(batch)
        q = self.value(batch.observations, batch.states, batch.actions.long())
        td_loss = smooth_l1_loss(q, y, reduction="none").mean(1)  # [K]
        self.descent.step(td_loss, scale)
        self.descent.follow(self.rates.polyak)
        return {"td_loss": td_loss.detach(), "q": q.detach().mean(1), "target": y.mean(1)}

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets and Adam's moments, as copies."""
        return self.descent.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.descent.load_state_dict(state)
