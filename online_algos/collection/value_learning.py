"""The parts of training that VDN and QMIX share: settings, acting, the replay, and the state.

The maths is in `online_algos.vdn` and `online_algos.qmix`, which take these functions as methods.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from swarmdata.learn.choices import bins
from swarmdata.learn.choices.bins import BinPolicy
from swarmdata.learn.networks.descent import Descent
from swarmdata.learn.networks.optimizer import linear
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.learn.objectives.value_losses import huber_error
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.exploration import LinearSchedule, epsilon_greedy
from swarmdata.learn.training.training_data import Data
from swarmdata.online_algos.collection.replay_collection import Collector
from swarmdata.types import Batch

LOSSES = ("td_loss", "q", "target")

UTILITY_STREAM, MIXER_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class ValueLearningConfig:
    """Settings that VDN and QMIX share; counts of steps are joint steps of one seed."""

    n_steps: int = 2_000_000
    n_copies: int = 64
    rollout_steps: int = 64  # of every copy in one round
    n_gradient_steps: int = 1  # after each of them
    batch_size: int = 512  # joint transitions
    capacity: int = 262_144  # transitions to draw from; with margin 1.1 GB of disk on coop_nav
    margin: int = 262_144  # most joint steps between two checkpoints of a run that can be resumed
    warmup_transitions: int = 8_192  # joint steps before the first gradient step
    n_bins: int = 9  # of each action dimension; odd, so that standing still is one
    hidden: tuple[int, ...] = (64, 64)
    n_critics: int = 1  # utility networks of a seed, J, whose mean chooses
    layer_norm: bool = False  # in the utility networks
    parameters: Parameters = "shared"
    frame: str = "target"  # in which robots see and act, `frames.find_frame`
    reward_weights: tuple[str, ...] = ()  # to learn with, `shaped_env.reweighted`
    learning_rate: float = 1e-3
    final_learning_rate_factor: float = 0.05  # at the end of training, reached linearly
    discount: float = 0.97
    reward_scale: float = 1.0
    tau: float = 0.01  # per gradient step
    epsilon: float = 1.0
    final_epsilon: float = 0.05
    exploration: float = 0.3  # part of training in which epsilon falls
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network


class Learner(Protocol):
    """Utility networks of K seeds that learn from batches of bins."""

    team: Team
    descent: Descent

    @property
    def config(self) -> ValueLearningConfig: ...
    def utilities(self, features: Tensor, network: StackedMLP | None = None) -> Tensor: ...
    def value(self, features: Tensor, states: Tensor, places: Tensor) -> Tensor: ...
    def targets(self, batch: Batch) -> Tensor: ...
    def update(self, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]: ...


class ValueLearning(Protocol):
    """An algorithm that collects transitions and learns from their replay."""

    collector: Collector
    schedule: LinearSchedule  # of epsilon

    @property
    def learner(self) -> Learner: ...


def utilities_of(self: Learner, features: Tensor, network: StackedMLP | None = None) -> Tensor:
    """Returns the utility of every bin, [K, J, B, N, D, C].

    Args:
        self: whose networks.
        features: normalized observations, [K, B, N, F].
        network: other parameters to use, those of the targets.
    """
    n_critics = self.config.n_critics
    outputs = self.team(features.repeat_interleave(n_critics, 0), network)
    utilities = bins.by_dimension(outputs, self.config.n_bins)
    return utilities.view(-1, n_critics, *utilities.shape[1:])


def by_critic(values: Tensor, utilities: Tensor) -> Tensor:
    """Returns values [K, B, N, D] once for each critic of utilities, [K, J, B, N, D]."""
    return values[:, None].expand(*utilities.shape[:-1])


def greedy_choices(utilities: Tensor) -> Tensor:
    """Returns the best bins, [K, B, N, D], of utilities [K, J, B, N, D, C]."""
    return bins.greedy(utilities.mean(1))


def td_update(self: Learner, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]:
    """One step on tensors [K, B, ...] down Huber(Q_tot - y); returns losses, each [K].

    Args:
        self: whose networks.
        batch: normalized observations and states, bins as actions.
        scale: factor on the learning rate.
    """
    y = self.targets(batch)  # [K, B], without a gradient
    q = self.value(batch.observations, batch.states, batch.actions)  # [K, J, B]
    td_loss = huber_error(q, y)  # [K]
    self.descent.step(td_loss, scale)
    self.descent.follow(self.config.tau)
    return {"td_loss": td_loss.detach(), "q": q.detach().mean((1, 2)), "target": y.mean(1)}


def update_round(self: ValueLearning) -> dict[str, Tensor]:
    """One round of acting and learning; returns losses, each [K], NaN before learning began."""

    def learn(batch: Batch) -> dict[str, Tensor]:
        factor = self.learner.config.final_learning_rate_factor
        scale = linear(self.collector.progress, factor)
        return self.learner.update(self.collector.normalized(batch), scale)

    return self.collector.round(lambda observations: explore(self, observations), learn, LOSSES)


@torch.no_grad()
def explore(self: ValueLearning, observations: Tensor) -> tuple[Tensor, Tensor]:
    """Returns actions and their bins, [K, E, N, D], chosen epsilon-greedily.

    Args:
        self: whose networks and schedule.
        observations: normalized, [K, E, N, O].
    """
    n_bins, epsilon = self.learner.config.n_bins, self.schedule.at(self.collector.progress)
    best = greedy_choices(self.learner.utilities(observations))
    chosen = epsilon_greedy(self.collector.acting, best, n_bins, epsilon)
    return bins.to_actions(chosen, n_bins), chosen.float()


def policy_of(self: ValueLearning, index: int) -> BinPolicy:
    """The greedy policy of seed number `index`, a copy of its parameters as they are now."""
    mean, std = self.collector.inputs_of(index)
    return BinPolicy(
        layers=self.learner.team.extract(index, self.learner.config.n_critics),
        observation_mean=mean,
        observation_std=std,
        n_bins=self.learner.config.n_bins,
        frame=self.collector.frame,
        parameters=self.learner.config.parameters,
        n_critics=self.learner.config.n_critics,
    )


def utility_team(sizes: Sizes, seeds: Sequence[int], config: ValueLearningConfig) -> Team:
    """Makes the utility networks of K seeds, whose outputs are D C utilities."""
    return Team(
        MLPShape(sizes.observation, config.hidden, sizes.action * config.n_bins, config.layer_norm),
        sizes.n_agents,
        seeds,
        UTILITY_STREAM,
        parameters=config.parameters,
        device="cpu",
        n_critics=config.n_critics,
    )


def skip_preparation(self: ValueLearning) -> bool:
    """Does nothing: the first rounds fill the replay."""
    return False


def mix_in(self: ValueLearning, data: Data, share: float) -> None:
    """Draws a share of each batch from recorded data, whose actions lie between two bins."""
    n_bins = self.learner.config.n_bins
    self.collector.mix_in(data, share, lambda actions: bins.places(actions, n_bins))


def restart_worlds(self: ValueLearning) -> None:
    """Begins new episodes everywhere, as loading a state does."""
    self.collector.worlds.restart()


def state_of(self: ValueLearning) -> dict[str, Tensor]:
    """Everything but the running episodes and the rows of the replay, as copies."""
    learner = {f"learner.{k}": v for k, v in self.learner.descent.state_dict().items()}
    return learner | {f"collector.{k}": v for k, v in self.collector.state_dict().items()}


def restore_state(self: ValueLearning, state: Mapping[str, Any]) -> None:
    """Restores what `state_dict` returned; the folder must be that of the same run.

    Raises:
        CheckpointError: the replay in the folder does not belong to the state.
    """
    self.collector.load_state_dict(part(state, "collector"))
    self.learner.descent.load_state_dict(part(state, "learner"))
