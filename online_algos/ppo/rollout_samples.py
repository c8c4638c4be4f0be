"""Rollouts of on-policy algorithms, and their samples as rows of stacked networks."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from swarmdata.learn.networks.team_networks import Parameters, by_network
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.specs.state_layout import N_COLUMNS, robots_of
from swarmdata.types import Bool, Float, Int, Step


class Rollout(NamedTuple):
    """Samples of K seeds, time first."""

    actor_inputs: Float  # [T, K, E, N, I]
    memories: Float  # [T, K, E, N, M] of the actors before the step
    actions: Float  # [T, K, E, N, A] without the noise that is carried over from the step before
    log_probs: Float  # [T, K, E, N]
    states: Float  # [T, K, E, N, S] further inputs of the critic, `critic_states`
    rewards: Float  # [T, K, E, N]
    values: Float  # [T, K, E, N]
    next_values: Float  # [T, K, E, N] of the next state, before any reset
    terminations: Bool  # [T, K, E]
    ended: Bool  # [T, K, E]


def empty_rollout(n_steps: int, n_inputs: int, memory_size: int, worlds: Worlds) -> Rollout:
    """A rollout of zeros, for actors of `n_inputs` inputs that remember `memory_size` numbers."""
    sizes = worlds.sizes
    shape = (n_steps, worlds.n_seeds, worlds.n_copies, sizes.n_agents)

    def zeros(*features: int) -> Float:
        return np.zeros((*shape, *features), np.float32)

    return Rollout(
        zeros(n_inputs), zeros(memory_size), zeros(sizes.action), zeros(),
        zeros(sizes.state), zeros(), zeros(), zeros(),
        np.zeros(shape[:3], np.bool_), np.zeros(shape[:3], np.bool_),
    )  # fmt: skip


STATE_SCALE = np.float32(0.5)
"""Scales states (m, m/s) to about 1 for the critic."""


def critic_states(step: Step) -> Float:
    """Each robot's view of the state: itself, the others in cyclic order, the rest, [E, N, S]."""
    n = step.rewards.shape[1]
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    rows = robots_of(step.states, n)[:, order].reshape(len(step.states), n, -1)
    rest = step.states[:, N_COLUMNS * n :]
    return np.concatenate([rows, np.repeat(rest[:, None], n, axis=1)], axis=-1) * STATE_SCALE


def ranks(seeds: Int) -> Int:
    """How many entries of the same seed come before each, [M]."""
    same = seeds[:, None] == seeds
    return np.tril(same, -1).sum(1)


def pad_by_seed(values: Float, seeds: Int, n_seeds: int) -> Float:
    """Returns rows [M, ...] by their seeds, [K, most of a seed, ...], padded with zeros."""
    rank = ranks(seeds)
    padded = np.zeros((n_seeds, int(rank.max()) + 1, *values.shape[1:]), values.dtype)
    padded[seeds, rank] = values
    return padded


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
    """Returns segments of L steps, by network as `sample_rows`, [R, segments, L, ...].

    T is a multiple of L = `window`; 1 gives samples of single steps.
    """
    segments = values.reshape(-1, window, *values.shape[1:])  # [S, L, K, E, N, ...]
    return sample_rows(segments.movedim(1, 4), parameters)


def minibatches(
    generators: Sequence[np.random.Generator], n_samples: int, n_rows: int, size: int
) -> Iterator[Tensor]:
    """Yields each of M samples once, in random order, as indices [K n_rows, B], B up to `size`.

    The `n_rows` networks of a seed take the same indices.
    """
    orders = np.stack([generator.permutation(n_samples) for generator in generators])
    yield from torch.split(torch.from_numpy(orders.repeat(n_rows, 0)), size, 1)


def seed_means(losses: Tensor, n_seeds: int) -> Tensor:
    """Returns the means over all samples of each seed, [K], of losses [K n_rows, B]."""
    return losses.view(n_seeds, -1).mean(1)
