"""Agents that have left an episode: they choose nothing, and no actor learns from their rows.

Critics do learn from them, that an agent which has left is worth nothing more.
"""

import torch
from torch import Tensor


def acting(actions: Tensor, alive: Tensor | None) -> Tensor:
    """Returns actions [..., N, A], 0 and without a gradient for agents that have left.

    `alive`, [..., N], is None where agents cannot leave.
    """
    return actions if alive is None else actions * alive[..., None]


def agent_mean(errors: Tensor, alive: Tensor | None) -> Tensor:
    """Returns the mean over rows and acting agents, [K], of errors [K, R, N, ...]."""
    if alive is None:
        return errors.mean(tuple(range(1, errors.ndim)))
    counts = alive.view(*alive.shape, *[1] * (errors.ndim - 3)).expand_as(errors)
    return torch.where(counts, errors, 0.0).flatten(1).sum(1) / counts.flatten(1).sum(1).clamp(
        min=1
    )
