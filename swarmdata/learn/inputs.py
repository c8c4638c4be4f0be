"""What enters the networks: normalized features and the number of the agent."""

from collections.abc import Sequence

import torch
from torch import Tensor


def standardize(values: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Returns (values - mean) / std; a constant feature, std below 1e-3, is only centered."""
    return (values - mean) / torch.where(std < 1e-3, 1.0, std)


def with_agent_id(features: Tensor) -> Tensor:
    """Appends a one-hot agent number, [..., N, F] to [..., N, F + N]."""
    n_agents = features.shape[-2]
    identity = torch.eye(n_agents, dtype=features.dtype, device=features.device)
    return torch.cat([features, identity.expand(*features.shape[:-1], n_agents)], -1)


def generators(seeds: Sequence[int], device: torch.device | str) -> list[torch.Generator]:
    """Returns one generator per seed on `device`, for noise that does not depend on K."""
    return [torch.Generator(device).manual_seed(seed) for seed in seeds]
