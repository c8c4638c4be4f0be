"""Segments of episodes: what a policy has remembered there, and the steps that it learns from.

A window [K, B, L, ...] is a segment and the steps before it, which only bring the memory up to
date. From there on its steps are learned from like any other transitions. A segment at the end of
an episode has less than `window` steps: these fill it evenly, each as often as the next or once
more, so that losses need neither masks nor weights, and every segment counts as much as another.
Segments are drawn in proportion to their steps, so every step of the data counts the same.
"""

from collections.abc import Callable
from dataclasses import fields

import torch
from torch import Tensor

from swarmdata.learn.memory.gated_networks import StackedGates, memories, next_memory
from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.team_networks import Parameters, by_network, from_rows, to_rows
from swarmdata.types import Batch


def learned_rows(mask: Tensor, window: int) -> Tensor:
    """Returns which steps of B windows are learned from, [K, B window], rows of [K, B L].

    The segment is the last `window` steps of each; the mask, [K, B, L], is False on padding.
    """
    n_windows, length = mask.shape[1:]
    n_steps = mask[:, :, length - window :].sum(2, keepdim=True)  # [K, B, 1]
    place = torch.arange(window, device=mask.device) * n_steps // window
    first = torch.arange(n_windows, device=mask.device)[:, None] * length + (length - window)
    return (first + place).flatten(1)


def take(values: Tensor, rows: Tensor) -> Tensor:
    """Returns the steps `rows` [K, R] of windows [K, B, L, ...], fields [K, R, ...]."""
    return taken(values.flatten(1, 2), rows)


def taken(values: Tensor, rows: Tensor) -> Tensor:
    """Returns the rows [K, R] of values [K, M, ...], [K, R, ...]; or [K, R, N], each robot's."""
    index = rows.view(*rows.shape, *[1] * (values.ndim - rows.ndim))
    return values.gather(1, index.expand(*rows.shape, *values.shape[rows.ndim :]))


def each_field(batch: Batch, change: Callable[[Tensor], Tensor | None]) -> Batch:
    """Returns a batch with a change made to every field that it has."""
    values = {field.name: getattr(batch, field.name) for field in fields(batch)}
    return Batch(**{k: None if v is None else change(v) for k, v in values.items()})


def learned_steps(batch: Batch, rows: Tensor) -> Batch:
    """Returns the steps `rows` [K, R] of a batch of windows as transitions, fields [K, R, ...]."""
    return each_field(batch, lambda values: take(values, rows))


def remembered(
    network: StackedGates, features: Tensor, mask: Tensor, parameters: Parameters
) -> Tensor:
    """Returns what each robot remembers after each step of windows, [K, B, L, N, M].

    The memory is empty at the first step of a window, or of its episode. Features are normalized,
    [K, B, L, N, F], the mask, [K, B, L], is False on padding, where they do not matter.
    """
    seen = features.masked_fill(~mask[..., None, None], 0.0)
    if parameters == "shared":
        seen = with_agent_id(seen)
    starts = torch.ones_like(mask)
    starts[:, :, 1:] = ~mask[:, :, :-1]
    starts = starts[..., None].expand(*mask.shape, features.shape[3])
    by_time = _by_time(seen, parameters), _by_time(starts, parameters)
    history = memories(network.layers, *by_time)
    k, b, length, n = features.shape[:4]
    joined = from_rows(history.transpose(1, 2).flatten(2), (k, b, n), parameters)
    return joined.reshape(k, b, n, length, -1).transpose(2, 3)


def learned(
    network: StackedGates, batch: Batch, features: Tensor, window: int, parameters: Parameters
) -> tuple[Batch, Tensor, Tensor]:
    """Returns transitions of windows to learn from, fields [K, R, ...], and what is known there.

    That are normalized features, [K, R, N, F], and what robots remember, [K, R, N, M].
    """
    rows = learned_rows(batch.mask, window)
    memory = take(remembered(network, features, batch.mask, parameters), rows)
    return learned_steps(batch, rows), take(features, rows), memory


def _by_time(values: Tensor, parameters: Parameters) -> Tensor:
    """Returns values [K, B, L, N, ...] by network, shared [K, L, B N, ...] or [K N, L, B, ...]."""
    return by_network(values.transpose(2, 3), parameters).transpose(1, 2)


def remembered_next(
    network: StackedGates, features: Tensor, memory: Tensor, parameters: Parameters
) -> Tensor:
    """Returns what each robot remembers one step later, [K, R, N, M].

    Features are those of the next step, normalized, [K, R, N, F], the memory, [K, R, N, M], that
    after this step.
    """
    rows = by_network(memory, parameters)
    after = next_memory(network.layers, to_rows(features, parameters), rows)
    return from_rows(after, memory.shape, parameters)
