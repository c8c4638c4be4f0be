"""Rollouts of MAPPO: samples of K seeds, and their values."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from swarmdata.online_algos.actors.mean_actors import Actors
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.ppo.networks import Critic
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


def critic_states(step: Step, first: int) -> Float:
    """Each robot's view of the state: itself, the others in cyclic order, the rest, [E, N, S].

    The robots begin with number `first` of those in the state.
    """
    n = step.rewards.shape[1]
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    before, states = np.split(step.states, [N_COLUMNS * first], axis=1)
    rows = robots_of(states, n)[:, order].reshape(len(states), n, -1)
    rest = np.concatenate([states[:, N_COLUMNS * n :], before], axis=1)
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


def fill_values(
    rollout: Rollout, ends: Sequence[Step], worlds: Worlds, actors: Actors, critic: Critic
) -> None:
    """Writes `values` and `next_values` of a rollout whose other fields are written.

    `ends` are, for each step, the last steps of the episodes that ended in it; `worlds` are in the
    step after the rollout.
    """
    r, first = rollout, worlds.first_robot
    r.values[:] = critic.values(torch.from_numpy(r.actor_inputs), torch.from_numpy(r.states))
    inputs = actors.inputs(worlds.observations(worlds.current_step))[None]
    states = torch.from_numpy(worlds.grouped(critic_states(worlds.current_step, first)))[None]
    r.next_values[:] = np.concatenate([r.values[1:], critic.values(inputs, states)])
    t, k, e = np.nonzero(r.ended)
    if len(t):
        last = Step._make(map(np.concatenate, zip(*ends, strict=True)))
        inputs = actors.inputs(pad_by_seed(worlds.local_observations(last), k, worlds.n_seeds))
        states = torch.from_numpy(pad_by_seed(critic_states(last, first), k, worlds.n_seeds))
        r.next_values[t, k, e] = critic.values(inputs[None], states[None])[0][k, ranks(k)]
