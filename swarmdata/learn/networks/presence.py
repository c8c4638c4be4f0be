"""Agents that have left an episode: they choose nothing, and no actor learns from their rows.

Nor do critics of own rewards. An agent's own return ends with its own termination (`robot_ends`).
After its own truncation, its value is that of the place it has reached, which critics know from
agents that are there; rows of absent ones would teach them that the place is worth nothing. Critics
of the team's reward learn from all rows, since that reward goes on without an agent. They, too,
bootstrap from the place that an agent was cut at (`going_on`): a time limit cuts all agents.
"""

import torch
from torch import Tensor

from swarmdata.types import Batch

PRESENCE = ("alive", "next_alive", "agent_terminations")
"""Fields of a batch that say who is there, and who leaves."""


def acting(actions: Tensor, alive: Tensor | None) -> Tensor:
    """Returns what agents do, see or are worth, [..., N, A], 0 and without a gradient where absent.

    `alive`, [..., N], is None where agents cannot leave.
    """
    return actions if alive is None else actions * alive[..., None]


def robot_ends(batch: Batch) -> Tensor:
    """Returns after which steps a robot gets no reward of its own, bool [..., N] or [..., 1].

    Those are the terminations of the team and its own ones, and steps in which it is absent.
    """
    ends: Tensor = batch.terminations[..., None]
    if batch.alive is None:
        return ends
    return ends | batch.agent_terminations | ~batch.alive


def going_on(batch: Batch) -> Tensor | None:
    """Returns whose values go on after a step, bool [..., N]; None where agents cannot leave.

    Those are agents that act next, and agents that were cut: all of them at a time limit.
    """
    if batch.alive is None:
        return None
    found: Tensor = batch.next_alive | (batch.alive & ~batch.agent_terminations)
    return found


def agent_mean(errors: Tensor, alive: Tensor | None) -> Tensor:
    """Returns the mean over rows and acting agents, [K], of errors [K, R, N, ...]."""
    if alive is None:
        return errors.mean(tuple(range(1, errors.ndim)))
    counts = alive.view(*alive.shape, *[1] * (errors.ndim - 3)).expand_as(errors)
    return torch.where(counts, errors, 0.0).flatten(1).sum(1) / counts.flatten(1).sum(1).clamp(
        min=1
    )
