"""UtilityNetworks: the networks of offline value decomposition, and the loop that trains them.

The maths is in `offline_algos.vdn` and `offline_algos.qmix`, which take these functions as methods:

    update, policy = regularised_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor

from swarmdata.learn.choices import bins
from swarmdata.learn.choices.behavior_heads import (
    Head,
    Regulariser,
    Rule,
    behavior_log_probs,
    head_size,
)
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.team_memory import TeamMemory
from swarmdata.learn.networks.descent import Descent
from swarmdata.learn.networks.network_inputs import information
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.perceptrons import Layer, MLPShape, StackedMLP
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.learn.objectives.value_losses import behavior_loss, conservative_gap, huber_error
from swarmdata.learn.policies.choice_policy import ChoicePolicy, RecurrentChoicePolicy
from swarmdata.learn.training.actor_critic import Loss
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch

LOSSES = ("td_loss", "q", "greedy_q", "target", "behavior_loss", "conservative_gap")
"""`greedy_q` is the online value of what the policy would choose: where it leaves `q`, the value of
the data's actions, and both leave what the data return, values are overestimated."""

GREEDY_EVERY = 10
"""Updates between two measurements of `greedy_q`, which nothing learns from."""

N_CRITICS = 2
"""Utility networks, and mixers, of a seed."""

UTILITY_STREAM, MIXER_STREAM, BEHAVIOR_STREAM, MEMORY_STREAM = 0, 1, 2, 3
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class DecompositionConfig(MemorySettings):
    """Settings that VDN and QMIX share; one setting for all datasets."""

    regulariser: Regulariser = "bc"  # the best on average of the three
    n_updates: int = 10_000
    batch_size: int = 256  # joint transitions
    n_bins: int = 9  # of a continuous column; odd, so that standing still is one
    hidden: tuple[int, ...] = (128, 128)
    parameters: Parameters = "shared"
    learning_rate: float = 3e-3  # see `bc`
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rate
    discount: float = 0.95  # as maddpg_bc
    tau: float = 0.01  # per update
    clip_target: bool = True  # at R*; see the docstring of `vdn`
    temperature: float = 0.5  # lambda of `bc`; see the docstring of `vdn`
    threshold: float = 0.5  # of `bcq`; Beeson et al. 2024
    behavior_head: Head = "factored"
    cql_weight: float = 0.1  # alpha of `cql`; see the docstring of `vdn`
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network

    @property
    def rule(self) -> Rule:
        """How robots choose."""
        return Rule(self.regulariser, self.temperature, self.threshold, self.behavior_head)


class UtilityNetworks:
    """K seeds of two utility networks, their targets, and a behavior head where it is needed.

    With a memory, one gated unit of a seed remembers for all of these networks, which see its
    memory beside the present observation. The targets see that of a target copy.

    Args:
        setup: sizes, seeds and the dataset's statistics.
        config: settings.
        mixer: networks of a mixer to train along; None if nothing of it is learned.
    """

    def __init__(
        self, setup: Setup, config: DecompositionConfig, mixer: StackedMLP | None = None
    ) -> None:
        self.config, self.rule = config, config.rule
        sizes, seeds, device = setup.sizes, setup.seeds, setup.device
        self.choices = Choices.of(sizes, config.n_bins, device)
        self.normalizer = Normalizer(setup.statistics, device, clip_target=config.clip_target)
        self._sizes, self._statistics = sizes, setup.statistics
        self.memory: TeamMemory | None = None
        n_features = sizes.observation
        if config.has_memory:
            self.memory = TeamMemory(setup, config, MEMORY_STREAM, config.parameters)
            n_features += config.memory_size
        n_utilities = self.choices.n_columns * self.choices.n_choices
        # networks that bootstrap have LayerNorm, cloning needs none
        self.team = Team(
            MLPShape(n_features, config.hidden, n_utilities, layer_norm=True),
            sizes.n_agents, seeds, UTILITY_STREAM,
            parameters=config.parameters, device=device, n_critics=N_CRITICS,
        )  # fmt: skip
        networks: dict[str, Any] = {"team": self.team.network}
        networks |= {} if mixer is None else {"mixer": mixer}
        networks |= {} if self.memory is None else {"memory": self.memory.network}
        followed, self.behavior = tuple(networks), None
        if self.rule.has_behavior:
            n_outputs = head_size(self.choices, config.behavior_head)
            self.behavior = Team(
                MLPShape(n_features, config.hidden, n_outputs),
                sizes.n_agents, seeds, BEHAVIOR_STREAM,
                parameters=config.parameters, device=device,
            )  # fmt: skip
            networks["behavior"] = self.behavior.network
        self.descent = Descent(
            networks, len(seeds), config.learning_rate, config.max_grad_norm, followed
        )

    def see(self, batch: Batch) -> "Seen":
        """Returns transitions [K, B, ...], and what networks see of them.

        Args:
            batch: transitions, or windows [K, B, L, ...] with a memory.
        """
        if self.memory is not None:
            slow = self.descent.targets["memory"]
            return Seen(*self.memory.along(batch, self.normalizer.observations, slow))
        features = self.normalizer.observations(batch.observations)
        after = self.normalizer.observations(batch.next_observations)
        return Seen(batch, features, after, after)

    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns both networks' utilities of every choice, [K, J, B, N, D, C].

        Args:
            features: normalized observations, with the memory if there is one, [K, B, N, F].
            network: other parameters to use, those of the targets.
        """
        outputs = self.team(features.repeat_interleave(N_CRITICS, 0), network)
        return by_critic(bins.by_dimension(outputs, self.choices.n_choices))

    def information(self, states: Tensor, features: Tensor) -> Tensor:
        """Returns x, normalized, [K, B, S + N O].

        Args:
            states: as recorded, [K, B, S].
            features: what the networks see; of it, the observations, which come first, are taken.
        """
        observations = features[..., : self._sizes.observation]
        return information(self.normalizer.states(states), observations)

    def log_probs(self, features: Tensor) -> Tensor | None:
        """Returns log pi_b, [K, B, N, D, C], or [K, B, N, C ** D] of a joint head.

        None without a behavior head.
        """
        if self.behavior is None:
            return None
        return behavior_log_probs(self.behavior(features), self.choices, self.rule.head)

    def act(self, utilities: Tensor, log_probs: Tensor | None) -> Tensor:
        """Returns the actions of the rule as weights of the choices, [K, B, N, D, C].

        Args:
            utilities: of both networks, [K, J, B, N, D, C]; their mean decides.
            log_probs: of the behavior head.
        """
        return self.rule.act(utilities.mean(1), log_probs, self.choices)

    def regulariser_loss(self, batch: "Evaluated") -> Loss:
        """Returns L_b with `bc` and `bcq`, L_cql with `cql`, and zeros with `none`."""
        config, weights = self.config, batch.weights
        if batch.log_probs is not None:
            loss = behavior_loss(batch.log_probs, weights, config.behavior_head)  # [K]
            return Loss(loss, {"behavior_loss": loss})
        if config.regulariser == "cql":
            gap = conservative_gap(batch.utilities, weights, self.choices.exists)  # [K]
            return Loss(config.cql_weight * gap, {"conservative_gap": gap})
        return Loss(weights.new_zeros(len(weights)), {})

    def policy(self, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
        """The greedy policy of seed number `index`, a copy of its parameters as they are now."""
        n_rows = N_CRITICS * self.team.n_rows
        behavior: list[Layer] = [] if self.behavior is None else self.behavior.extract(index)
        chooser = ChoicePolicy(
            layers=self.team.network.extract(index * n_rows, torch.float64, n_rows),
            behavior=behavior,
            observation_mean=torch.tensor(self._statistics.observation_mean, dtype=torch.float64),
            observation_std=torch.tensor(self._statistics.observation_std, dtype=torch.float64),
            choices=self.choices.to_cpu(),
            ranges=self._sizes.choices,
            rule=self.rule,
            frame=self._sizes.frame,
            parameters=self.config.parameters,
        )
        if self.memory is None:
            return chooser
        return RecurrentChoicePolicy(self.memory.extract(index), chooser)


class Seen(NamedTuple):
    """Transitions, and what networks see of them: features F, of a memory too if there is one."""

    batch: Batch  # fields [K, B, ...]
    features: Tensor  # [K, B, N, F]
    next_features: Tensor  # without a gradient if there is a memory, [K, B, N, F]
    slow_next_features: Tensor  # what the targets see, [K, B, N, F]


class Evaluated(NamedTuple):
    """A batch as the networks see it."""

    weights: Tensor  # the data's actions as weights of the choices, [K, B, N, D, C]
    utilities: Tensor  # [K, J, B, N, D, C]
    log_probs: Tensor | None  # of the behavior head
    information: Tensor  # x, normalized, [K, B, S + N O]


class Decomposition(Protocol):
    """What `regularised_update` needs of an algorithm."""

    n_updates: int
    networks: UtilityNetworks

    def targets(self, seen: Seen) -> Tensor:
        """Returns y, [K, B]."""
        ...

    def value(self, utilities: Tensor, weights: Tensor, x: Tensor) -> Tensor:
        """Returns Q of joint actions, [K, J, B], with x as in `Evaluated.information`."""
        ...


def regularised_loss(self: Decomposition, batch: Evaluated, y: Tensor) -> Loss:
    """Returns L_td with L_b or L_cql of the regulariser, [K]; y, [K, B], is a constant."""
    q = self.value(batch.utilities, batch.weights, batch.information)  # [K, J, B]
    td_loss = huber_error(q, y)  # [K]
    near_data = self.networks.regulariser_loss(batch)
    reported = {"td_loss": td_loss, "q": q.mean((1, 2)), "target": y.mean(1)}
    return Loss(td_loss + near_data.total, reported | near_data.reported)


def regularised_update(self: Decomposition, batch: Batch) -> dict[str, Tensor]:
    """One step on tensors [K, B, ...], windows with a memory; returns losses [K].

    Losses that the regulariser does not have are left out.
    """
    networks, config = self.networks, self.networks.config
    seen = networks.see(batch)
    y = self.targets(seen)  # [K, B]
    batch, features = seen.batch, seen.features
    evaluated = Evaluated(
        networks.choices.weights(batch.actions),
        networks.utilities(features),
        networks.log_probs(features),
        networks.information(batch.states, features),
    )
    total, reported = regularised_loss(self, evaluated, y)
    if self.n_updates % GREEDY_EVERY == 0:
        with torch.no_grad():
            greedy = networks.act(evaluated.utilities, evaluated.log_probs)
            values = self.value(evaluated.utilities, greedy, evaluated.information)
        reported["greedy_q"] = values.mean((1, 2))
    scale = cosine(self.n_updates, config.n_updates, config.final_learning_rate_factor)
    networks.descent.step(total, scale)
    networks.descent.follow(config.tau)
    self.n_updates += 1
    return {name: loss.detach() for name, loss in reported.items()}


def policy_of(self: Decomposition, index: int) -> ChoicePolicy | RecurrentChoicePolicy:
    """The greedy policy of seed number `index`, as it is now."""
    return self.networks.policy(index)


def state_of(self: Decomposition) -> dict[str, Any]:
    """Parameters, targets, Adam's moments and the number of updates, as copies."""
    state = self.networks.descent.state_dict()
    named = {f"networks.{name}": value for name, value in state.items()}
    return {"n_updates": torch.tensor(self.n_updates), **named}


def restore_state(self: Decomposition, state: Mapping[str, Any]) -> None:
    """Restores what `state_dict` returned."""
    self.n_updates = int(state["n_updates"])
    self.networks.descent.load_state_dict(part(state, "networks"))


def by_critic(values: Tensor) -> Tensor:
    """Returns values [K J, ...] of neighboring networks as [K, J, ...]."""
    return values.view(-1, N_CRITICS, *values.shape[1:])
