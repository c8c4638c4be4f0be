"""Offline value decomposition: twin utilities of choices, a mixer, and what keeps them near data.

What VDN and QMIX share; they differ in the mixer f. Robot i sees o_i; column d of its action has C
choices with utilities U_j(o_i)_dk, j = 1, 2. A recorded action a is a weight w_k(a_id) of each
choice: 1 and 0 of recorded choices, the linear interpolation of the two nearest knots of continuous
actions. With team reward r, the mean over robots:

    Q_j(o_i, a_i) = 1/D sum_dk w_k(a_id) U_j(o_i)_dk              (Seyde et al. 2023, equation 2)
    Q_j(s, o, a)  = f_j(Q_j(o_1, a_1), ..., Q_j(o_N, a_N); s)     (Rashid et al. 2018, equation 4)
    a'_i  = rule(1/2 sum_j U_j(o'_i), pi_b(. | o'_i))             chosen by the online networks
    y     = r + gamma (1 - termination) min(1/2 sum_j Q'_j(s', o', a'), R*)   valued by the targets
    L_td  = sum_j Huber(Q_j(s, o, a) - y)
    L_b   = -sum_id sum_k w_k(a_id) log pi_b(k | o_i)_d / N       with `bc` and `bcq`
    L_cql = alpha sum_j mean_id [log sum_k exp U_j(o_i)_dk - sum_k w_k(a_id) U_j(o_i)_dk]

The rule is `behavior.Rule`, and the policy acts by the same rule: a mask that is only in the target
lets the policy take what was never valued (as OG-MARL's `qmix_bcq` does). L_cql is conservative
Q-learning (Kumar et al. 2020, equation 4) robot by robot and column by column; the sum over joint
actions has no such form and was found unstable. That the online networks choose and the targets
value is double Q-learning (van Hasselt et al. 2016, equation 4).

R* is the largest discounted return-to-go of the dataset (`clip_target`, as `maddpg_bc` has it).
Without it the weights of QMIX's mixer and its values drive each other up: on random choices in
`simple_spread_v3` values rose above 0, where every return is negative, and the policies earned less
than the data. With it they earn more (tests/record/test_playing_choices.py).

`temperature` and `conservative_weight` (alpha) are in units of scaled rewards; Beeson et al. have 1
and 0.25 in raw ones. On `coop_nav` (3,500 updates of 128 rows, hidden sizes 64, 2 seeds, 100
episodes) `vdn` with `bc` scored 48 on medium-replay and 94 on expert with temperature 1, and 60 and
87 with 0.3; the default is between. With `cql`, in the world's frame (4,000 updates), alpha 0.1
scored 39 on medium-replay and 0.25 22.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.choices import bins
from swarmdata.learn.choices.behavior_heads import (
    Head,
    Regulariser,
    Rule,
    behavior_log_probs,
    cross_entropy,
    head_size,
)
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.networks.descent import Descent
from swarmdata.learn.networks.mixers import Mixer
from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.perceptrons import Layer, MLPShape, StackedMLP
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.policies.choice_policy import ChoicePolicy
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch

LOSSES = ("td_loss", "q", "greedy_q", "target", "behavior_loss", "conservative_gap")
"""`greedy_q` is the online value of what the policy would choose: where it leaves `q`, the value of
the data's actions, and both leave what the data return, values are overestimated."""

GREEDY_EVERY = 10
"""Updates between two measurements of `greedy_q`, which nothing learns from."""

TWINS = 2
UTILITY_STREAM, MIXER_STREAM, BEHAVIOR_STREAM = 0, 1, 2
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class FactoredConfig:
    """Settings that VDN and QMIX share; one setting for all datasets."""

    regulariser: Regulariser = "bc"  # the best on average in cards/studies/coop_nav
    n_updates: int = 10_000
    batch_size: int = 256  # joint transitions
    n_choices: int = 9  # knots of a continuous column; odd, so that standing still is one
    hidden: tuple[int, ...] = (128, 128)
    parameters: Parameters = "shared"
    step_size: float = 3e-3  # see `bc`
    final_step_size: float = 0.0  # factor at the end of the cosine; 1 keeps the step size
    discount: float = 0.95  # as maddpg_bc
    polyak: float = 0.01  # per update
    clip_target: bool = True  # at R*; see the module's docstring
    temperature: float = 0.5  # lambda of `bc`; see the docstring
    threshold: float = 0.5  # of `bcq`; Beeson et al. 2024
    behavior_head: Head = "factored"
    conservative_weight: float = 0.1  # alpha of `cql`; see the docstring
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind

    @property
    def rule(self) -> Rule:
        """How robots choose."""
        return Rule(self.regulariser, self.temperature, self.threshold, self.behavior_head)


class FactoredValues:
    """K seeds of twin utility networks with twin mixers, and of a behavior head where it is needed.

    Args:
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        config: settings.
        build_mixer: makes mixers of K seeds and `TWINS` twins.
        statistics: of the dataset: normalization and reward scale.
        device: where to train.
    """

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: FactoredConfig,
        build_mixer: Callable[[], Mixer],
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.config, self.rule, self.n_updates = config, config.rule, 0
        self.choices = Choices.of(sizes, config.n_choices, device)
        self._ranges, self._frame = sizes.choices, sizes.frame
        n_utilities = self.choices.n_columns * self.choices.n_choices
        self.team = _team(sizes, seeds, config, n_utilities, UTILITY_STREAM, TWINS, device)
        self.mixer, self.behavior = build_mixer(), None
        networks = {"team": self.team.network}
        if self.mixer.network is not None:
            networks["mixer"] = self.mixer.network
        followed = tuple(networks)
        if self.rule.has_behavior:
            size = head_size(self.choices, config.behavior_head)
            self.behavior = _team(sizes, seeds, config, size, BEHAVIOR_STREAM, 1, device)
            networks["behavior"] = self.behavior.network
        norm = config.max_gradient_norm
        self.descent = Descent(networks, len(seeds), config.step_size, norm, followed)
        self.reward_scale = 1 / statistics.return_std
        self.max_value = statistics.max_return * self.reward_scale  # R*
        self._statistics = statistics
        self._moments = [
            torch.tensor(moment).to(device, torch.float32)
            for moment in (
                statistics.observation_mean,
                statistics.observation_std,
                statistics.state_mean,
                statistics.state_std,
            )
        ]

    def update(self, batch: Batch) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...]; returns losses [K], those that the regulariser has."""
        config = self.config
        features, states = self.normalized(batch.observations, batch.states)
        y = self.targets(batch)  # [K, B]
        weights = self.choices.weights(batch.actions)  # [K, B, N, D, C]
        utilities = self.utilities(features)  # [K, J, B, N, D, C]
        q = self.value(utilities, weights, states)  # [K, J, B]
        td_loss = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none").mean(2).sum(1)
        losses = {"td_loss": td_loss, "q": q.mean((1, 2)), "target": y.mean(1)}
        total, log_probs = td_loss, None
        if config.regulariser == "cql":
            losses["conservative_gap"] = gap = self._gap(utilities, weights)
            total = total + config.conservative_weight * gap
        if self.behavior is not None:
            log_probs = self.log_probs(features)
            losses["behavior_loss"] = loss = self._behavior_loss(log_probs, weights)
            total = total + loss
        if self.n_updates % GREEDY_EVERY == 0:
            losses["greedy_q"] = self._greedy_q(utilities, log_probs, states)
        self.descent.step(total, cosine(self.n_updates, config.n_updates, config.final_step_size))
        self.descent.follow(config.polyak)
        self.n_updates += 1
        return {name: loss.detach() for name, loss in losses.items()}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards."""
        features, states = self.normalized(batch.next_observations, batch.next_states)
        weights = self.act(features)
        utilities = self.utilities(features, self.descent.targets["team"])
        q_next = self.value(utilities, weights, states, self.descent.targets.get("mixer")).mean(1)
        if self.config.clip_target:
            q_next = q_next.clamp(max=self.max_value)
        r = team_reward(batch.rewards) * self.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def act(self, features: Tensor) -> Tensor:
        """Returns the online networks' actions as weights of the choices, [K, B, N, D, C]."""
        log_probs = None if self.behavior is None else self.log_probs(features)
        return self.rule.act(self.utilities(features).mean(1), log_probs, self.choices)

    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns both twins' utilities of every choice, [K, J, B, N, D, C].

        Args:
            features: normalized observations, [K, B, N, O].
            network: other parameters to use, those of the targets.
        """
        outputs = self.team(features.repeat_interleave(TWINS, 0), network)
        return by_twin(bins.by_dimension(outputs, self.choices.n_choices))

    def value(
        self,
        utilities: Tensor,
        weights: Tensor,
        states: Tensor,
        mixer: StackedMLP | None = None,
    ) -> Tensor:
        """Returns Q of joint actions, [K, J, B].

        Args:
            utilities: [K, J, B, N, D, C].
            weights: the actions as weights of the choices, [K, B, N, D, C].
            states: normalized, [K, B, S].
            mixer: other parameters to use, those of the targets.
        """
        return self.mix((utilities * weights[:, None]).sum(-1).mean(-1), states, mixer)

    def mix(self, values: Tensor, states: Tensor, mixer: StackedMLP | None = None) -> Tensor:
        """Returns team values, [K, J, B], of robots' values [K, J, B, N]."""
        twice = states.repeat_interleave(TWINS, 0)
        return by_twin(self.mixer(values.flatten(0, 1), twice, mixer))

    def log_probs(self, features: Tensor) -> Tensor:
        """Returns log pi_b, [K, B, N, D, C], or [K, B, N, C ** D] of a joint head."""
        if self.behavior is None:
            raise ValueError(f"{self.rule} has no behavior head")
        return behavior_log_probs(self.behavior(features), self.choices, self.rule.head)

    def normalized(self, observations: Tensor, states: Tensor) -> tuple[Tensor, Tensor]:
        """Returns observations and states in units of the dataset's deviations."""
        mean, std, state_mean, state_std = self._moments
        return standardize(observations, mean, std), standardize(states, state_mean, state_std)

    @torch.no_grad()
    def _greedy_q(self, utilities: Tensor, log_probs: Tensor | None, states: Tensor) -> Tensor:
        """Mean value of what the policy would choose where the data are, [K]."""
        greedy = self.rule.act(utilities.mean(1), log_probs, self.choices)
        return self.value(utilities, greedy, states).mean((1, 2))

    def _gap(self, utilities: Tensor, weights: Tensor) -> Tensor:
        """How far all choices together lie above the data's, summed over twins, [K]."""
        taken = (utilities * weights[:, None]).sum(-1)  # [K, J, B, N, D]
        if self.choices.exists is not None:
            utilities = utilities.masked_fill(~self.choices.exists, -torch.inf)
        return (utilities.logsumexp(-1) - taken).mean((2, 3, 4)).sum(1)

    def _behavior_loss(self, log_probs: Tensor, weights: Tensor) -> Tensor:
        return cross_entropy(log_probs, weights, self.rule.head).mean((1, 2))

    def policy(self, index: int) -> ChoicePolicy:
        """The greedy policy of seed number `index`, a copy of its parameters as they are now."""
        n_rows = TWINS * self.team.n_rows
        behavior: list[Layer] = [] if self.behavior is None else self.behavior.extract(index)
        return ChoicePolicy(
            layers=self.team.network.extract(index * n_rows, torch.float64, n_rows),
            behavior=behavior,
            observation_mean=torch.tensor(self._statistics.observation_mean, dtype=torch.float64),
            observation_std=torch.tensor(self._statistics.observation_std, dtype=torch.float64),
            choices=self.choices.to_cpu(),
            ranges=self._ranges,
            rule=self.rule,
            frame=self._frame,
            parameters=self.config.parameters,
        )

    def state_dict(self) -> dict[str, Any]:
        """Parameters, targets, Adam's moments and the number of updates, as copies."""
        networks = {f"networks.{key}": value for key, value in self.descent.state_dict().items()}
        return {"n_updates": torch.tensor(self.n_updates), **networks}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        self.descent.load_state_dict(part(state, "networks"))


def by_twin(values: Tensor) -> Tensor:
    """Returns values [K J, ...] of neighboring twins as [K, J, ...]."""
    return values.view(-1, TWINS, *values.shape[1:])


def _team(
    sizes: Sizes,
    seeds: Sequence[int],
    config: FactoredConfig,
    n_outputs: int,
    stream: int,
    n_twins: int,
    device: torch.device | str,
) -> Team:
    """Networks of what robots see; twins, which bootstrap, have LayerNorm, cloning needs none."""
    shape = MLPShape(sizes.observation, config.hidden, n_outputs, layer_norm=n_twins > 1)
    return Team(
        shape,
        sizes.n_agents,
        seeds,
        stream,
        parameters=config.parameters,
        device=device,
        n_twins=n_twins,
    )
