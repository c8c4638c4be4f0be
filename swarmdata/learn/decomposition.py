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

from swarmdata.learn import bins
from swarmdata.learn.checkpoint import part
from swarmdata.learn.mixers import Mixer
from swarmdata.learn.networks import StackedMLP, backward
from swarmdata.learn.optimizer import StackedAdam
from swarmdata.learn.targets import polyak, td_target, team_reward
from swarmdata.learn.team import Team
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
        self.target_team = team.network.clone()
        self.target_mixer = None if mixer.network is None else mixer.network.clone()
        self._adams = {
            name: StackedAdam(network, n_seeds, rates.step_size, rates.max_gradient_norm)
            for name, network in self._trained().items()
        }

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
        utilities = self.utilities(batch.next_observations, self.target_team)
        q_next = self.mixer(bins.chosen(utilities, choices), batch.next_states, self.target_mixer)
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
        backward(td_loss.sum(), list(self._trained().values()))
        for adam in self._adams.values():
            adam.descend(scale)
        for target, network in zip(self._targets(), self._trained().values(), strict=True):
            polyak(target, network, self.rates.polyak)
        return {"td_loss": td_loss.detach(), "q": q.detach().mean(1), "target": y.mean(1)}

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets and Adam's moments, as copies."""
        state = {}
        for (name, network), target in zip(self._trained().items(), self._targets(), strict=True):
            state[name], state[f"target_{name}"] = network.flat.clone(), target.flat.clone()
            state |= {f"{name}_adam.{k}": v for k, v in self._adams[name].state_dict().items()}
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        for (name, network), target in zip(self._trained().items(), self._targets(), strict=True):
            network.load(state[name])
            target.load(state[f"target_{name}"])
            self._adams[name].load_state_dict(part(state, f"{name}_adam"))

    def _trained(self) -> dict[str, StackedMLP]:
        networks = {"team": self.team.network}
        return networks if self.mixer.network is None else networks | {"mixer": self.mixer.network}

    def _targets(self) -> list[StackedMLP]:
        return [self.target_team] + ([] if self.target_mixer is None else [self.target_mixer])
