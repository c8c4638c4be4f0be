"""Exploration of K seeds: schedules, noise on continuous actions, random choices."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.network_inputs import normal_like


@dataclass(frozen=True, slots=True)
class LinearSchedule:
    """Goes from `start` to `end` over the first `duration` of training, and stays there.

    Raises:
        SchemaError: the duration is not in (0, 1].
    """

    start: float
    end: float
    duration: float = 1.0

    def __post_init__(self) -> None:
        """Checks the duration."""
        if not 0 < self.duration <= 1:
            raise SchemaError(f"{self}: duration is a part of training, expected above 0 and to 1")

    def at(self, progress: float) -> float:
        """Returns the value when a part `progress` of training, 0 to 1, is done."""
        return self.start + (self.end - self.start) * min(1.0, progress / self.duration)


def gaussian(generators: Sequence[torch.Generator], actions: Tensor, deviation: float) -> Tensor:
    """Returns actions with Gaussian noise, clipped to [-1, 1].

    Args:
        generators: one per seed, [K].
        actions: [K, ...].
        deviation: of the noise.
    """
    noise = normal_like(generators, actions)
    return (actions + deviation * noise).clamp(-1, 1)


def epsilon_greedy(
    generators: Sequence[torch.Generator], choices: Tensor, n_choices: int, epsilon: float
) -> Tensor:
    """Returns choices of which each robot replaces all its dimensions with probability epsilon.

    Args:
        generators: one per seed, [K].
        choices: greedy ones, whole numbers [K, E, N, D].
        n_choices: how many there are in each dimension.
        epsilon: probability that a robot chooses uniformly in this step.
    """
    e, n = choices.shape[1:3]
    device = choices.device
    fresh = torch.stack([
        torch.randint(n_choices, choices.shape[1:], generator=g, device=g.device)
        for g in generators
    ])  # fmt: skip
    coin = torch.stack([torch.rand((e, n, 1), generator=g, device=g.device) for g in generators])
    return torch.where((coin < epsilon).to(device), fresh.to(device), choices)
