"""The parts of training that actor-critics share: settings, the update loop of TD3, and the state.

The losses are in the files of the algorithms. An algorithm takes these functions as its methods:

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor

from swarmdata.learn.extraction.second_stage import ExtractionConfig, SecondStage, Valuer
from swarmdata.learn.networks.actor import DelayedActor, PolicyNetwork, StackedActor
from swarmdata.learn.networks.network_inputs import generator_states, restore_generators
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch


@dataclass(frozen=True)
class ActorCriticConfig:
    """Settings that all actor-critics have; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 256  # joint transitions
    actor_hidden: tuple[int, ...] = (128, 128)
    policy_network: PolicyNetwork = "mlp"  # `deep_sets` acts in teams of any size
    critic_hidden: tuple[int, ...] = (128, 128)  # of everything that estimates values
    actor_learning_rate: float = 3e-3  # see `bc`
    critic_learning_rate: float = 1e-3  # see `maddpg_bc`
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rates
    discount: float = 0.95  # see `maddpg_bc`
    tau: float = 0.01  # per update of the targets; 0.005 was too slow for 20,000 updates
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network


@dataclass(frozen=True)
class DelayedConfig(ActorCriticConfig):
    """The settings of TD3 (Fujimoto et al. 2018) and of the warm-up by behavior cloning."""

    policy_delay: int = 2  # Fujimoto & Gu 2021, table 3; the next two too
    smoothing: float = 0.2  # deviation of the noise on the targets' actions
    smoothing_clip: float = 0.5
    bc_warmup_updates: int = 4_000  # in which the actors clone the data


@dataclass(frozen=True)
class TwoStageConfig(DelayedConfig, ExtractionConfig):
    """The settings of TD3, of the warm-up, and of the second stage."""


def squashed_actor(setup: Setup, config: ActorCriticConfig) -> StackedActor:
    """Makes the actors of K seeds, whose outputs pass through tanh."""
    sizes, seeds, statistics = setup.sizes, setup.seeds, setup.statistics
    return StackedActor(
        sizes, seeds, config.actor_hidden, statistics,
        squash=True, device=setup.device, policy_network=config.policy_network,
    )  # fmt: skip


def delayed_actor(setup: Setup, config: ActorCriticConfig) -> DelayedActor:
    """Makes the actors of K seeds with their slow copies."""
    return DelayedActor(
        squashed_actor(setup, config),
        setup.n_seeds,
        learning_rate=config.actor_learning_rate,
        max_norm=config.max_grad_norm,
    )


def second_stage(
    setup: Setup,
    config: TwoStageConfig,
    actor: DelayedActor,
    generators: Sequence[torch.Generator],
) -> SecondStage | None:
    """Makes what the second stage needs; None if the config has none."""
    if config.extraction == "joint":
        return None
    return SecondStage(
        actor,
        setup.seeds,
        generators,
        config,
        config.n_updates,
        learning_rate=config.actor_learning_rate,
        max_norm=config.max_grad_norm,
    )


class Loss(NamedTuple):
    """A loss of K seeds, and the quantities to report beside it."""

    total: Tensor  # [K], what is minimized
    reported: dict[str, Tensor]  # each [K]


class Trained(Protocol):
    """Networks with an optimizer and slow copies."""

    def step(self, loss: Tensor, scale: float = 1.0) -> None: ...
    def follow(self, rate: float) -> None: ...
    def state_dict(self) -> dict[str, Tensor]: ...
    def load_state_dict(self, state: Mapping[str, Any]) -> None: ...


class Actor(Protocol):
    """Deterministic policies of K seeds."""

    def policy(self, index: int) -> TorchPolicy | SetPolicy: ...


class HasActor(Protocol):
    """An algorithm whose policies are those of its actors."""

    @property
    def actor(self) -> Actor: ...


class ActorCritic(Protocol):
    """Actors and critics of K seeds, and the noise of their training."""

    n_updates: int
    actor: DelayedActor
    generators: list[torch.Generator]  # one per seed, [K]

    @property
    def second_stage(self) -> SecondStage | None: ...  # None: there is one stage only
    @property
    def config(self) -> Any: ...
    @property
    def critics(self) -> Trained: ...


class DelayedActorCritic(ActorCritic, Protocol):
    """Losses of critics, and of actors that move less often."""

    @property
    def config(self) -> DelayedConfig: ...

    def valuer(self, batch: Batch, x: Any) -> Valuer:
        """Returns the critics' values of a batch's actions, for a second stage."""
        ...

    def critic_inputs(self, batch: Batch) -> Any:
        """Returns what the critics see of a batch besides actions; passed to both losses."""
        ...

    def critic_loss(self, batch: Batch, x: Any) -> Loss:
        """Returns the critics' loss; draws noise."""
        ...

    def bc_loss(self, pi: Tensor, actions: Tensor) -> Tensor:
        """Returns the imitation loss, [K], of the policies' actions [K, B, N, A]."""
        ...

    def actor_loss(self, batch: Batch, x: Any, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns the actors' loss after the warm-up, in which it is `bc_loss` alone."""
        ...


def delayed_update(self: DelayedActorCritic, batch: Batch) -> dict[str, Any]:
    """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves.

    Critics move in every update. Actors and targets move in every update of the warm-up, and then
    in every `policy_delay`-th (Fujimoto et al. 2018, algorithm 1). In the second stage, only the
    actors move.
    """
    config, stage = self.config, self.second_stage
    scale, is_second = stage_of(config, stage, self.n_updates)
    x = self.critic_inputs(batch)
    reported: dict[str, Tensor] = {}
    if stage is None or not is_second or not stage.has_frozen_critics:
        total, reported = self.critic_loss(batch, x)
        self.critics.step(total, scale)
    self.n_updates += 1
    is_warmup = self.n_updates <= config.bc_warmup_updates
    if stage is not None and is_second:
        reported |= extract(self, stage, batch, self.valuer(batch, x), scale)
    elif is_warmup or self.n_updates % config.policy_delay == 0:
        pi = self.actor(batch.observations)  # [K, B, N, A]
        reported["bc_loss"] = total = self.bc_loss(pi, batch.actions)
        if not is_warmup:
            total, reported_of_actor = self.actor_loss(batch, x, pi, total)
            reported |= reported_of_actor
        self.actor.step(total, scale)
        if stage is not None:
            reported["density_loss"] = stage.learn_density(batch, scale)
        follow(self)
    return {name: loss.detach() for name, loss in reported.items()}


def stage_of(
    config: ActorCriticConfig, stage: SecondStage | None, n_updates: int
) -> tuple[float, bool]:
    """Returns the factor on learning rates after `n_updates`, and whether the second stage runs.

    Each stage has a cosine of its own.
    """
    floor = config.final_learning_rate_factor
    first = config.n_updates if stage is None else stage.begins_at
    if stage is None or n_updates < first:
        return cosine(n_updates, first, floor), False
    return cosine(n_updates - first, config.n_updates - first, floor), True


def extract(
    self: ActorCritic, stage: SecondStage, batch: Batch, valuer: Valuer, scale: float
) -> dict[str, Tensor]:
    """One step of the second stage; returns its losses, each [K]."""
    losses = stage.update(batch, valuer, scale)
    if not stage.has_frozen_critics:
        follow(self)
    return losses


def follow(self: ActorCritic) -> None:
    """Moves the slow copies of actors and critics."""
    self.actor.follow(self.config.tau)
    self.critics.follow(self.config.tau)


def smoothed_actions(self: ActorCritic, observations: Tensor) -> Tensor:
    """Returns pi'(o') + clip(noise, -c, c), [K, B, N, A], in [-1, 1]; draws the noise."""
    config = self.config
    return self.actor.smoothed(
        observations, self.generators, config.smoothing, config.smoothing_clip
    )


def policy_of(self: HasActor, index: int) -> TorchPolicy | SetPolicy:
    """The policy of seed number `index`, as it is now."""
    return self.actor.policy(index)


def state_of(self: ActorCritic) -> dict[str, Any]:
    """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
    return {
        "n_updates": torch.tensor(self.n_updates),
        "generators": generator_states(self.generators),
        **self.actor.state_dict(),
        **self.critics.state_dict(),
        **({} if self.second_stage is None else self.second_stage.state_dict()),
    }


def restore_state(self: ActorCritic, state: Mapping[str, Any]) -> None:
    """Restores what `state_dict` returned."""
    self.n_updates = int(state["n_updates"])
    restore_generators(self.generators, state["generators"])
    self.actor.load_state_dict(state)
    self.critics.load_state_dict(state)
    if self.second_stage is not None:
        self.second_stage.load_state_dict(state)
