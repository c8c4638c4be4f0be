"""Inputs of the networks: normalized features, the agent's number, and noise."""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.numerics.random import derive
from swarmdata.types import Double


def standardize(values: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Returns (values - mean) / std; a constant feature, std below 1e-3, is only centered."""
    return (values - mean) / torch.where(std < 1e-3, 1.0, std)


class Standardization:
    """Centers observations and divides them by their deviation, in training and when acting.

    Attributes:
        mean: for policies, float64 [O] on the CPU.
        std: likewise.

    Args:
        mean: of observations, [O].
        std: likewise.
        device: where batches are.
    """

    def __init__(self, mean: Double, std: Double, device: torch.device | str) -> None:
        self.mean = torch.tensor(mean, dtype=torch.float64)
        self.std = torch.tensor(std, dtype=torch.float64)
        self._mean, self._std = (m.to(device, torch.float32) for m in (self.mean, self.std))

    def __call__(self, observations: Tensor) -> Tensor:
        """Returns observations as recorded, float32 [..., O], as networks see them."""
        return standardize(observations, self._mean, self._std)


def with_agent_id(features: Tensor) -> Tensor:
    """Appends a one-hot agent number, [..., N, F] to [..., N, F + N]."""
    n_agents = features.shape[-2]
    identity = torch.eye(n_agents, dtype=features.dtype, device=features.device)
    return torch.cat([features, identity.expand(*features.shape[:-1], n_agents)], -1)


def information(states: Tensor, observations: Tensor) -> Tensor:
    """Returns critic inputs besides actions: x = (s, o_1, ..., o_N), [K, B, S + N O].

    The state alone does not say where the obstacles are, so a critic of it cannot tell a free way
    from a blocked one.

    Args:
        states: normalized, [K, B, S].
        observations: normalized, [K, B, N, O].
    """
    return torch.cat([states, observations.flatten(2)], 2)


def generators(
    seeds: Sequence[int], device: torch.device | str, stream: int | None = None
) -> list[torch.Generator]:
    """Returns one generator per seed on `device`, for noise that does not depend on K.

    Args:
        seeds: of the runs, [K].
        device: where numbers are drawn.
        stream: separates the purposes for which one seed draws; None seeds with the run's own seed.
    """
    derived = seeds if stream is None else [int(derive(seed, stream)[0] >> 1) for seed in seeds]
    return [torch.Generator(device).manual_seed(seed) for seed in derived]


def generator_states(generators: Sequence[torch.Generator]) -> Tensor:
    """Returns the states of some generators for a checkpoint, uint8 [G, bytes]."""
    return torch.stack([generator.get_state() for generator in generators])


def restore_generators(generators: Sequence[torch.Generator], states: Tensor) -> None:
    """Restores what `generator_states` returned.

    Raises:
        ValueError: there are more or fewer states than generators.
    """
    for generator, state in zip(generators, states, strict=True):
        generator.set_state(state.cpu().clone())
