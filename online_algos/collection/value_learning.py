"""The loop of VDN and QMIX: robots that choose among knots, epsilon-greedily, and learn by replay.

What differs between them is the mixer (`learn.mixers`); the maths is in `learn.decomposition`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from swarmdata.interfaces import VecEnv
from swarmdata.learn.choices import bins
from swarmdata.learn.choices.bins import BinPolicy
from swarmdata.learn.choices.decomposition import LOSSES, Decomposition, Rates
from swarmdata.learn.networks.mixers import Mixer
from swarmdata.learn.networks.optimizer import linear
from swarmdata.learn.networks.perceptrons import MLPShape
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.networks.team_networks import Parameters, Team
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.exploration import LinearSchedule, epsilon_greedy
from swarmdata.online_algos.collection.replay_collection import Collector, Plan
from swarmdata.types import Batch

UTILITY_STREAM, MIXER_STREAM = 0, 1
"""Streams of a seed's initial parameters."""


@dataclass(frozen=True)
class ChoosingConfig:
    """Settings that VDN and QMIX share; counts of frames are joint steps of one seed."""

    n_steps: int = 2_000_000
    n_copies: int = 64
    rollout_steps: int = 64  # of every copy in one round
    n_gradient_steps: int = 1  # after each of them
    batch_size: int = 512  # joint transitions
    capacity: int = (
        262_144  # transitions that are drawn from; with margin 1.1 GB of disk on coop_nav
    )
    margin: int = 262_144  # most frames between two checkpoints of a run that can be resumed
    warmup_transitions: int = 8_192  # joint steps before the first gradient step
    n_choices: int = 9  # knots of each action dimension; odd, so that standing still is one
    hidden: tuple[int, ...] = (64, 64)
    parameters: Parameters = "shared"
    frame: str = "target"  # in which robots see and act, `frames.find_frame`
    step_size: float = 1e-3
    final_step_size: float = 0.05  # factor at the end of training, reached linearly
    discount: float = 0.97
    reward_scale: float = 1.0
    polyak: float = 0.01  # per gradient step
    epsilon: float = 1.0
    final_epsilon: float = 0.05
    exploration: float = 0.3  # part of training in which epsilon falls
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class Choosing:
    """K seeds of robots that choose; implements `interfaces.OnlineAlgorithm` but for its names.

    Args:
        env: K E copies.
        seeds: of everything random, [K].
        config: settings.
        folder: of the replay.
        build_mixer: makes the mixer for these sizes and seeds.
    """

    def __init__(
        self,
        env: VecEnv,
        seeds: Sequence[int],
        config: ChoosingConfig,
        folder: Path | str,
        build_mixer: Callable[[Sizes, Sequence[int]], Mixer],
    ) -> None:
        self.config = config
        self.collector = Collector(env, seeds, Plan.of(config), folder)
        sizes = self.collector.sizes
        self.learner = make_learner(sizes, seeds, config, build_mixer(sizes, seeds))
        self.schedule = LinearSchedule(config.epsilon, config.final_epsilon, config.exploration)

    def update(self) -> dict[str, Tensor]:
        """One round; returns losses, each [K]."""
        return self.collector.round(self._act, self._learn, LOSSES)

    def policy(self, index: int) -> BinPolicy:
        """The greedy policy of seed number `index`, a copy of its parameters as they are now."""
        mean, std = self.collector.inputs_of(index)
        return BinPolicy(
            layers=self.learner.team.extract(index),
            observation_mean=mean,
            observation_std=std,
            n_choices=self.config.n_choices,
            frame=self.collector.frame,
            parameters=self.config.parameters,
        )

    def state_dict(self) -> dict[str, Tensor]:
        """Everything but the running episodes and the rows of the replay, as copies."""
        learner = {f"learner.{k}": v for k, v in self.learner.state_dict().items()}
        return learner | {f"collector.{k}": v for k, v in self.collector.state_dict().items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned and begins new episodes."""
        self.collector.load_state_dict(part(state, "collector"))
        self.learner.load_state_dict(part(state, "learner"))

    @torch.no_grad()
    def _act(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        n_choices, epsilon = self.config.n_choices, self.schedule.at(self.collector.progress)
        best = bins.greedy(self.learner.utilities(observations))
        choices = epsilon_greedy(self.collector.acting, best, n_choices, epsilon)
        return bins.to_actions(choices, n_choices), choices.float()

    def _learn(self, batch: Batch) -> dict[str, Tensor]:
        scale = linear(self.collector.progress, self.config.final_step_size)
        return self.learner.update(batch, scale)


def make_learner(
    sizes: Sizes, seeds: Sequence[int], config: ChoosingConfig, mixer: Mixer
) -> Decomposition:
    """Makes the learner of K seeds; with `sizes.action` 1 it is that of a discrete action space.

    Args:
        sizes: numbers of robots and features; `action` is the number of choices to make.
        seeds: of the initial parameters, [K].
        config: settings; `n_choices` is how many there are in each dimension.
        mixer: of the same seeds.
    """
    shape = MLPShape(sizes.observation, config.hidden, sizes.action * config.n_choices)
    team = Team(
        shape, sizes.n_agents, seeds, UTILITY_STREAM, parameters=config.parameters, device="cpu"
    )
    rates = Rates(
        discount=config.discount,
        reward_scale=config.reward_scale,
        step_size=config.step_size,
        polyak=config.polyak,
        max_gradient_norm=config.max_gradient_norm,
    )
    return Decomposition(team, mixer, len(seeds), config.n_choices, rates)
