"""Inputs of networks: normalized features, the agent's number, noise; rewards in their units."""

import math
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor

from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.presence import robot_ends
from swarmdata.numerics.random import derive
from swarmdata.types import Batch, Double


def standardize(values: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Returns (values - mean) / std; a constant feature, std below 1e-3, is only centered."""
    return (values - mean) / torch.where(std < 1e-3, 1.0, std)


class Standardization:
    """Centers features [F] and divides them by their deviation, in training and when acting."""

    def __init__(self, mean: Double, std: Double, device: torch.device | str) -> None:
        self.mean = torch.tensor(mean, dtype=torch.float64)  # for policies, float64 [F] on the CPU
        self.std = torch.tensor(std, dtype=torch.float64)  # likewise
        # both for batches, float32
        self.on_device = tuple(m.to(device, torch.float32) for m in (self.mean, self.std))

    @classmethod
    def of(cls, statistics: Statistics, device: torch.device | str) -> "Standardization":
        return cls(statistics.observation_mean, statistics.observation_std, device)

    def __call__(self, values: Tensor) -> Tensor:
        """Returns features as recorded, float32 [..., F], as networks see them."""
        return standardize(values, *self.on_device)


def with_agent_id(features: Tensor) -> Tensor:
    """Appends a one-hot agent number, [..., N, F] to [..., N, F + N]."""
    n_agents = features.shape[-2]
    identity = torch.eye(n_agents, dtype=features.dtype, device=features.device)
    return torch.cat([features, identity.expand(*features.shape[:-1], n_agents)], -1)


def information(states: Tensor, observations: Tensor) -> Tensor:
    """Returns critic inputs besides actions: x = (s, o_1, ..., o_N), [K, B, S + N O].

    States, [K, B, S], and observations, [K, B, N, O], are normalized. The state alone does not say
    where the obstacles are, so a critic of it cannot tell a free way from a blocked one.
    """
    return torch.cat([states, observations.flatten(2)], 2)


def generators(
    seeds: Sequence[int], device: torch.device | str, stream: int | None = None
) -> list[torch.Generator]:
    """Returns one generator for each seed on `device`, for noise that does not depend on K.

    `stream` separates the purposes for which a seed draws; None seeds with the run's own seed.
    """
    derived = seeds if stream is None else [int(derive(seed, stream)[0]) >> 1 for seed in seeds]
    return [torch.Generator(device).manual_seed(seed) for seed in derived]


def normal_like(generators: Sequence[torch.Generator], values: Tensor) -> Tensor:
    """Returns standard normal numbers, [K, ...], each seed's from its own generator."""
    shape = values.shape[1:]
    return torch.stack([torch.randn(shape, generator=g, device=g.device) for g in generators])


def uniform_like(generators: Sequence[torch.Generator], values: Tensor) -> Tensor:
    """Returns uniform numbers in [0, 1), [K, ...], each seed's from its own generator."""
    shape = values.shape[1:]
    return torch.stack([torch.rand(shape, generator=g, device=g.device) for g in generators])


def generator_states(generators: Sequence[torch.Generator]) -> Tensor:
    """Returns the states of some generators for a checkpoint, uint8 [G, bytes]."""
    return torch.stack([generator.get_state() for generator in generators])


def restore_generators(generators: Sequence[torch.Generator], states: Tensor) -> None:
    """Restores what `generator_states` returned; as many generators as states."""
    for generator, state in zip(generators, states, strict=True):
        generator.set_state(state.cpu().clone())


class Normalizer:
    """States and observations in units of the moments of a dataset, on a device, in float32."""

    def __init__(self, statistics: Statistics, device: torch.device | str) -> None:
        moments = statistics.state_mean, statistics.state_std
        self.states = Standardization(*moments, device)  # normalizes states as recorded, [..., S]
        self.state_mean, self.state_std = self.states.on_device  # each [S]
        # normalizes observations as recorded, [..., O]
        self.observations = Standardization.of(statistics, device)

    def __call__(self, states: Tensor, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Returns states, [K, B, S], and observations, [K, B, N, O], as networks see them."""
        return self.states(states), self.observations(observations)


Reward = Literal["own", "team"]
"""Whether a robot's value is of its own rewards, or of the mean over the team."""


class RobotRewards:
    """Makes the scaled rewards that critics of each robot learn from, own or the team's mean.

    A mean over N robots spreads what one of them caused over all: its share falls with 1 / N, and
    the rewards of the others are noise.
    """

    def __init__(
        self, statistics: Statistics, reward: Reward, *, clip_target: bool = False
    ) -> None:
        is_own = reward == "own"
        self._is_own = is_own
        # 1 / standard deviation of the returns-to-go
        self.scale = 1 / (statistics.own_return_std if is_own else statistics.return_std)
        largest = statistics.own_max_return if is_own else statistics.max_return
        # R*, the largest return-to-go, in scaled rewards; infinite if it bounds nothing
        self.max_value = largest * self.scale if clip_target else math.inf
        width = statistics.own_return_range if is_own else statistics.return_range
        # largest less smallest undiscounted return of an episode, in scaled rewards
        self.return_range = width * self.scale

    def __call__(self, rewards: Tensor) -> Tensor:
        """Returns scaled rewards, [K, B, N], of rewards as recorded, [K, B, N]."""
        if not self._is_own:
            rewards = rewards.mean(-1, keepdim=True).expand_as(rewards)
        return rewards * self.scale

    def ends(self, batch: Batch) -> Tensor:
        """Returns after which steps no rewards follow, bool [K, B, N] or [K, B, 1]."""
        return robot_ends(batch) if self._is_own else batch.terminations[..., None]

    def learned(self, batch: Batch) -> Tensor | None:
        """Returns whose values critics learn, bool [K, B, N]; None: those of all."""
        return batch.alive if self._is_own else None
