"""UtilityNetworks: the networks of offline value decomposition (`offline_algos.vdn`, `qmix`)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

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
from swarmdata.learn.memory.gated_networks import GatedShape, StackedGates
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.segments import learned, remembered_next
from swarmdata.learn.networks.network_inputs import Normalizer, Reward, RobotRewards, information
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import Layer, MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.types import Batch

N_CRITICS = 2
"""Utility networks, and mixers, of a seed."""

UTILITY_STREAM, MIXER_STREAM, BEHAVIOR_STREAM, MEMORY_STREAM = 0, 1, 2, 3
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class DecompositionConfig(MemorySettings):
    """Settings that VDN and QMIX share; one setting for all datasets."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        "temperature": ("regulariser", ("bc",)),
        "threshold": ("regulariser", ("bcq",)),
        "behavior_head": ("regulariser", ("bc", "bcq")),
        "cql_weight": ("regulariser", ("cql",)),
    }

    regulariser: Regulariser = "bc"
    n_updates: int = 18_000
    batch_size: int = 128  # joint transitions
    n_bins: int = 9  # of a continuous column; odd, so that standing still is one
    hidden: tuple[int, ...] = (64, 64)
    parameters: Parameters = "shared"
    learning_rate: float = 3e-3  # see `bc`
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rate
    discount: float = 0.95  # as maddpg_bc
    tau: float = 0.03  # per update
    clip_target: bool = True  # at R*; see the docstring of `vdn`
    temperature: float = 0.5  # lambda of `bc`; see the docstring of `vdn`
    threshold: float = 0.5  # of `bcq`; Beeson et al. 2024
    behavior_head: Head = "factored"
    cql_weight: float = 0.1  # alpha of `cql`; see the docstring of `vdn`
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network

    @property
    def reward(self) -> Reward:
        """Whose reward a value is of."""
        return "team"

    @property
    def rule(self) -> Rule:
        return Rule(self.regulariser, self.temperature, self.threshold, self.behavior_head)


class TeamMemory:
    """Gated units of K seeds: one that all robots of a seed share, or one for each robot."""

    def __init__(
        self, setup: Setup, settings: MemorySettings, stream: int, parameters: Parameters
    ) -> None:
        is_shared, n_agents = parameters == "shared", setup.sizes.n_agents
        self.parameters, self.window = parameters, settings.window
        self.n_rows = 1 if is_shared else n_agents  # networks of one seed
        n_inputs = setup.sizes.observation + (n_agents if is_shared else 0)
        shape = GatedShape(n_inputs, settings.memory_size)
        self.network = StackedGates(shape, setup.n_seeds * self.n_rows, setup.device)
        initialize(self.network, setup.seeds, stream)

    def along(
        self, batch: Batch, normalize: Callable[[Tensor], Tensor], slow: StackedGates
    ) -> tuple[Batch, Tensor, Tensor, Tensor]:
        """Returns transitions of windows [K, B, L, ...], [K, R, ...], and what is seen of them.

        `normalize` makes observations as recorded comparable, `slow` are copies of the units. Seen
        are normalized observations with memories, [K, R, N, O + M]; these one step later, and what
        the copies see then, both without a gradient.
        """
        features = normalize(batch.observations)
        steps, now, memory = learned(self.network, batch, features, self.window, self.parameters)
        with torch.no_grad():
            after = normalize(steps.next_observations)
            kept = learned(slow, batch, features, self.window, self.parameters)[2]
            later, slow_later = (
                torch.cat([after, remembered_next(network, after, held, self.parameters)], -1)
                for network, held in ((self.network, memory), (slow, kept))
            )
        return steps, torch.cat([now, memory], -1), later, slow_later

    def extract(self, index: int) -> list[Layer]:
        """Returns a copy of the units of seed number `index`, float64, on the CPU."""
        return self.network.extract(index * self.n_rows, torch.float64, self.n_rows)


class UtilityNetworks:
    """K seeds of two utility networks, their targets, and a behavior head where it is needed.

    With a memory, one gated unit of a seed remembers for all of these networks; the targets see
    that of a target copy. `mixer` is trained along.
    """

    def __init__(
        self, setup: Setup, config: DecompositionConfig, mixer: StackedMLP | None = None
    ) -> None:
        self.config, self.rule = config, config.rule
        sizes, seeds, device = setup.sizes, setup.seeds, setup.device
        self.choices = Choices.of(sizes, config.n_bins, device)
        self.normalizer = Normalizer(setup.statistics, device)
        self.rewards = RobotRewards(setup.statistics, config.reward, clip_target=config.clip_target)
        self.sizes = sizes
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

        With a memory the batch is of windows, [K, B, L, ...].
        """
        if self.memory is not None:
            slow = self.descent.targets["memory"]
            return Seen(*self.memory.along(batch, self.normalizer.observations, slow))
        features = self.normalizer.observations(batch.observations)
        after = self.normalizer.observations(batch.next_observations)
        return Seen(batch, features, after, after)

    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns both networks' utilities, [K, J, B, N, D, C], of what they see, [K, B, N, F]."""
        outputs = self.team(features.repeat_interleave(N_CRITICS, 0), network)
        return by_critic(bins.by_dimension(outputs, self.choices.n_choices))

    def information(self, states: Tensor, features: Tensor) -> Tensor:
        """Returns x, normalized, [K, B, S + N O], of states as recorded, [K, B, S].

        Features are what the networks see, [K, B, N, F]; observations come first in them.
        """
        observations = features[..., : self.sizes.observation]
        return information(self.normalizer.states(states), observations)

    def log_probs(self, features: Tensor) -> Tensor | None:
        """Returns log pi_b, [K, B, N, D, C] or [K, B, N, C ** D]; None without a behavior head."""
        if self.behavior is None:
            return None
        return behavior_log_probs(self.behavior(features), self.choices, self.rule.head)

    def act(self, utilities: Tensor, log_probs: Tensor | None) -> Tensor:
        """Returns the rule's actions as weights of the choices, [K, B, N, D, C].

        Utilities are [K, J, B, N, D, C], of which the mean over J decides; log_probs those of the
        behavior head.
        """
        return self.rule.act(utilities.mean(1), log_probs, self.choices)

    def state_dict(self) -> dict[str, Tensor]:
        return {f"networks.{k}": v for k, v in self.descent.state_dict().items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.descent.load_state_dict({k.removeprefix("networks."): v for k, v in state.items()})


class Seen(NamedTuple):
    """Transitions, and what networks see of them: features F, of a memory too if there is one."""

    batch: Batch  # fields [K, B, ...]
    features: Tensor  # [K, B, N, F]
    next_features: Tensor  # without a gradient if there is a memory, [K, B, N, F]
    slow_next_features: Tensor  # what the targets see, [K, B, N, F]


def by_critic(values: Tensor) -> Tensor:
    """Returns values [K J, ...] of neighboring networks as [K, J, ...]."""
    return values.view(-1, N_CRITICS, *values.shape[1:])
