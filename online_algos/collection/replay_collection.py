"""Off-policy algorithms: they act in worlds, store transitions and learn from batches of them."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError, SpecError
from swarmdata.learn.networks.network_inputs import (
    generator_states,
    generators,
    normal_like,
    restore_generators,
)
from swarmdata.learn.networks.optimizer import linear
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.replay_buffer import Replay, Shape
from swarmdata.learn.training.training_data import Data
from swarmdata.online_algos.collection.input_moments import (
    N_MEASURED,
    InputMoments,
    SeedNormalizer,
    measure_moments,
)
from swarmdata.online_algos.collection.recorded_rows import RecordedRows, joined
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.shaping.shaped_env import reweighted
from swarmdata.perception.frames import find_frame
from swarmdata.rollouts.side_env import AnyEnv, seen_in, whole_of
from swarmdata.types import Batch

ACTING_STREAM, SAMPLING_STREAM, MEASURING_STREAM = 10, 11, 12
"""Streams of a seed's generators."""


@dataclass(frozen=True)
class ReplaySettings:
    """Settings of every algorithm with a replay; steps are joint steps of one seed."""

    n_steps: int = 2_000_000
    n_copies: int = 64
    rollout_steps: int = 64  # of every copy in one round
    n_gradient_steps: int = 1  # after each of them
    batch_size: int = 512  # joint transitions
    capacity: int = 262_144  # transitions to sample from; with margin 1.1 GB of disk on coop_nav
    margin: int = 262_144  # most steps between two checkpoints of a run that can be resumed
    warmup_transitions: int = 8_192  # before the first gradient step
    parameters: Parameters = "shared"
    frame: str = "target"  # in which robots observe and act, `frames.find_frame`
    reward_weights: tuple[str, ...] = ()  # to learn with, `shaped_env.reweighted`
    final_learning_rate_factor: float = 0.05  # at the end of training, reached linearly
    discount: float = 0.97
    reward_scale: float = 1.0
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network

    def __post_init__(self) -> None:
        if self.capacity < self.n_copies:
            raise SchemaError(
                f"capacity is {self.capacity} with {self.n_copies} copies, expected at least one "
                "step of every copy"
            )


class OffPolicy(ABC):
    """K seeds of an algorithm that learns from a replay of their steps in worlds of their own.

    `env` has K E copies of a task, `folder` gets the replay.

    Attributes:
        frames: joint steps that each seed has taken.
        moments: frozen input statistics; those of an offline run that training starts from.
        recorded: the part of each batch that a dataset gives; None: batches are from the replay.
    """

    LOSSES: tuple[str, ...]  # of `learn`, and "reward"

    def __init__(self, env: AnyEnv, seeds: Sequence[int], config: Any, folder: Path | str) -> None:
        self.config, self.seeds, self.frames = config, tuple(seeds), 0
        self.frame = find_frame(env.features, config.frame, env.spec.robots)
        worlds = seen_in(reweighted(whole_of(env), config.reward_weights), env)
        self.worlds = Worlds(worlds, seeds, self.frame)
        if self.worlds.n_copies != config.n_copies:
            raise SchemaError(
                f"got {env.n_copies} copies for {len(seeds)} seeds, expected n_copies = "
                f"{config.n_copies} for each"
            )
        shape = Shape(self.worlds.sizes, len(seeds), config.n_copies, *_ring_rows(config))
        self.replay = Replay(shape, folder)
        self.acting = generators(seeds, "cpu", ACTING_STREAM)
        self._sampling = generators(seeds, "cpu", SAMPLING_STREAM)
        measuring = generators(seeds, "cpu", MEASURING_STREAM)
        self.moments = measure_moments(self.worlds, measuring, N_MEASURED)
        self.recorded: RecordedRows | None = None
        self.learner = self.new_learner()

    @abstractmethod
    def new_learner(self) -> Any:
        """Makes an untrained learner, for these sizes and statistics of inputs."""

    @abstractmethod
    def explore(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Returns actions, [K, E, N, A], and what is stored of them, [K, E, N, ...].

        Observations are normalized, [K, E, N, O].
        """

    @abstractmethod
    def learn(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        """Steps on tensors [K, B, ...] as they were seen, at `scale`; returns losses, [K]."""

    def prepare(self) -> bool:
        """Does nothing: the first rounds fill the replay."""
        return False

    def stored(self, actions: Tensor) -> Tensor:
        """Returns what the replay keeps of recorded actions in [-1, 1]."""
        return actions

    def mix_in(self, data: Data, share: float) -> None:
        """Draws a share of each batch from a dataset from now on, `collection.recorded_rows`."""
        weights, size = self.config.reward_weights, self.config.batch_size
        if weights:
            raise SpecError(
                f"reward_weights is {','.join(weights)} and recorded data are "
                "mixed in, whose rewards have the task's weights. Leave one of them out."
            )
        self.recorded = RecordedRows(data, self.frame, self.seeds, size, share, self.stored)

    @property
    def progress(self) -> float:
        """Part of the training that is done, in [0, 1]."""
        return min(1.0, self.frames / self.config.n_steps)

    def faded(self, start: float, end: float) -> float:
        """Returns a value now that goes to its end in the part `config.exploration` of training."""
        return start + (end - start) * min(1.0, self.progress / self.config.exploration)

    def update(self) -> dict[str, Tensor]:
        """Takes `rollout_steps` steps in all copies, with gradient steps after each.

        Returns means of losses, [K], NaN where no step returned them, and the mean team reward.
        """
        config = self.config
        losses: dict[str, list[Tensor]] = {name: [] for name in self.LOSSES}
        for _ in range(config.rollout_steps):
            losses["reward"].append(self._step())
            if self.frames < config.warmup_transitions:
                continue
            for _ in range(config.n_gradient_steps):
                scale = linear(self.progress, config.final_learning_rate_factor)
                for name, loss in self.learn(self.draw(), scale).items():
                    losses[name].append(loss)
        undefined = torch.full((len(self.seeds),), torch.nan)
        return {k: torch.stack(v).mean(0) if v else undefined for k, v in losses.items()}

    @torch.no_grad()
    def _step(self) -> Tensor:
        """Takes one step in all copies and stores it; returns the mean team reward, [K]."""
        worlds = self.worlds
        step = worlds.current_step
        observations = worlds.observations(step)
        normal = SeedNormalizer(self.moments)
        actions, stored = self.explore(normal.observations(torch.from_numpy(observations)))
        next_step = worlds.advance(actions.numpy())
        rewards = worlds.grouped(next_step.rewards)
        terminations = worlds.grouped(next_step.terminations)
        self.replay.append(
            Batch(
                observations=observations,
                actions=stored.numpy(),
                rewards=rewards,
                next_observations=worlds.observations(next_step),
                states=worlds.grouped(step.states),
                next_states=worlds.grouped(next_step.states),
                terminations=terminations,
                truncations=worlds.grouped(next_step.truncations),
                mask=np.ones_like(terminations),
            )
        )
        self.frames += worlds.n_copies
        return torch.from_numpy(rewards.mean((1, 2)))

    def draw(self) -> Batch:
        """Returns a batch of rows as they were seen, tensors [K, B, ...]."""
        n_recorded = 0 if self.recorded is None else self.recorded.n_rows
        batch = self.replay.sample(self._sampling, self.config.batch_size - n_recorded)
        if self.recorded is not None:
            batch = joined(batch, self.recorded.draw())
        return batch

    def normalized(self, batch: Batch) -> Batch:
        normal = SeedNormalizer(self.moments)
        return replace(
            batch,
            observations=normal.observations(batch.observations),
            next_observations=normal.observations(batch.next_observations),
            states=normal.states(batch.states),
            next_states=normal.states(batch.next_states),
        )

    def inputs_of(self, index: int) -> tuple[Tensor, Tensor]:
        """Mean and deviation of observations for the policy of seed number `index`, float64 [O]."""
        mean, std = (torch.from_numpy(m[index].astype(np.float64)) for m in self.moments[:2])
        return mean, std

    def restart_worlds(self) -> None:
        self.worlds.restart()

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes and the rows of the replay, as copies."""
        recorded = {} if self.recorded is None else self.recorded.state_dict()
        moments = self.moments._asdict()
        return {
            **{f"learner.{k}": v for k, v in self.learner.state_dict().items()},
            "collector.frames": torch.tensor(self.frames),
            **{f"collector.recorded.{k}": v for k, v in recorded.items()},
            "collector.generators": generator_states([*self.acting, *self._sampling]),
            **{f"collector.moments.{k}": torch.tensor(v) for k, v in moments.items()},
            **{f"collector.worlds.{k}": v for k, v in self.worlds.state_dict().items()},
            **{f"collector.replay.{k}": v for k, v in self.replay.state_dict().items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        own = part(state, "collector")
        self.replay.load_state_dict(part(own, "replay"))
        self.frames = int(own["frames"])
        restore_generators([*self.acting, *self._sampling], own["generators"])
        self.moments = InputMoments(
            **{k: v.numpy().copy() for k, v in part(own, "moments").items()}
        )
        self.worlds.load_state_dict(part(own, "worlds"))
        if self.recorded is not None:
            self.recorded.load_state_dict(part(own, "recorded"))
        self.learner = self.new_learner()
        self.learner.load_state_dict(part(state, "learner"))


def _ring_rows(config: ReplaySettings) -> tuple[int, int]:
    """Capacity and margin in rows of one step of every copy, no more than the run writes."""
    per_round = config.n_copies * config.rollout_steps
    of_run = math.ceil(config.n_steps / per_round) * config.rollout_steps
    capacity, margin = (math.ceil(n / config.n_copies) for n in (config.capacity, config.margin))
    return min(capacity, of_run), min(margin, max(of_run - capacity, 0))


def gaussian(generators: Sequence[torch.Generator], actions: Tensor, deviation: float) -> Tensor:
    """Returns actions [K, ...] with Gaussian noise of a deviation, clipped to [-1, 1].

    There is one generator for each seed.
    """
    noise = normal_like(generators, actions)
    return (actions + deviation * noise).clamp(-1, 1)


def epsilon_greedy(
    generators: Sequence[torch.Generator], choices: Tensor, n_choices: int, epsilon: float
) -> Tensor:
    """Returns choices [K, E, N, D], of which robots with probability epsilon redraw all their own.

    Choices are whole numbers, 0 to `n_choices` - 1; there is one generator for each of K seeds.
    """
    e, n = choices.shape[1:3]
    device = choices.device
    fresh = torch.stack([
        torch.randint(n_choices, choices.shape[1:], generator=g, device=g.device)
        for g in generators
    ])  # fmt: skip
    coin = torch.stack([torch.rand((e, n, 1), generator=g, device=g.device) for g in generators])
    return torch.where((coin < epsilon).to(device), fresh.to(device), choices)
