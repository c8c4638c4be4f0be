"""Samples of K seeds as rows of stacked networks, and minibatches of them."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.team_networks import Parameters, by_network


def pick(values: Tensor, rows: Tensor) -> Tensor:
    """Returns the samples [R, B, ...] of values [R, M, ...] at the indices [R, B]."""
    n_rows, n_samples = values.shape[:2]
    flat = rows + torch.arange(n_rows)[:, None] * n_samples
    picked = values.flatten(0, 1).index_select(0, flat.flatten())
    return picked.view(*rows.shape, *values.shape[2:])


def sample_rows(values: Tensor, parameters: Parameters) -> Tensor:
    """Returns samples [T, K, E, N, ...] by network: [K, T E N, ...], separate [K N, T E, ...]."""
    return by_network(values.transpose(0, 1).flatten(1, 2), parameters)


def sample_segments(values: Tensor, parameters: Parameters, window: int) -> Tensor:
    """Returns segments of L steps of values [T, K, E, N, ...], by network, [R, segments, L, ...].

    Networks are those of `sample_rows`. T is a multiple of L = `window`; 1 gives single steps.
    """
    segments = values.reshape(-1, window, *values.shape[1:])  # [S, L, K, E, N, ...]
    return sample_rows(segments.movedim(1, 4), parameters)


def minibatches(
    generators: Sequence[np.random.Generator], n_samples: int, n_rows: int, size: int
) -> Iterator[Tensor]:
    """Yields each of M = `n_samples` once, in random order, as indices [K n_rows, B], B <= `size`.

    There is one generator for each of K seeds; the `n_rows` networks of a seed take the same
    indices.
    """
    orders = np.stack([generator.permutation(n_samples) for generator in generators])
    yield from torch.split(torch.from_numpy(orders.repeat(n_rows, 0)), size, 1)


def seed_means(losses: Tensor, n_seeds: int) -> Tensor:
    """Returns the means over all samples of each seed, [K], of losses [K n_rows, B]."""
    return losses.view(n_seeds, -1).mean(1)
