"""Clones a teacher into actors, so that training starts from a careful driver.

Source: DAgger, Ross, Gordon and Bagnell, "A reduction of imitation learning and structured
prediction to no-regret online learning", AISTATS 2011, algorithm 3.1, with beta = 1 in the first
round and 0 after. The learner acts with noise, so that it meets states that need corrections.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.online_algos.collection.training_worlds import Worlds, standard_normal
from swarmdata.online_algos.ppo.networks import Actors
from swarmdata.online_algos.ppo.rollout_samples import minibatches, pick, sample_rows, seed_means
from swarmdata.types import Float, Int, Step


class Teacher(Protocol):
    """What is cloned: policies, and teams that are only needed for labels."""

    def reset(self, step: Step, copies: Int) -> None:
        """Clears the memory of `copies`; see `interfaces.Policy.reset`."""
        ...

    def act(self, step: Step) -> Float:
        """Returns joint actions; see `interfaces.Policy.act`."""
        ...


@dataclass(frozen=True)
class CloneConfig:
    """Rounds of collection and regression."""

    n_rounds: int = 10
    rollout_steps: int = 256  # per round and copy
    n_passes: int = 2  # over all data so far, per round
    max_samples: int = 1_500_000  # robot samples that the passes of a round may take together
    final_passes: int = 4  # more after the last round, each at half the learning rate before it
    minibatch: int = 2048  # robot samples
    learning_rate: float = 1e-3
    noise: float = 0.1  # standard deviation of the learner's actions


def clone_teacher(
    actors: Actors,
    worlds: Worlds,
    generators: Sequence[np.random.Generator],
    teacher: Teacher,
    config: CloneConfig,
) -> list[Tensor]:
    """Fits actors to a teacher; returns the mean squared errors after each round, each [K].

    A round goes on where the one before it stopped, so that episodes longer than a round are seen
    to their ends. `worlds` are left in the middle of episodes.
    """
    optimizer = StackedAdam(actors.network, len(generators), 1.0)
    worlds.restart()
    teacher.reset(worlds.current_step, np.arange(worlds.env.n_copies))
    errors = []
    for k in tqdm(range(config.n_rounds), desc="cloning the teacher", unit="round", disable=None):
        collected = _collect(actors, worlds, generators, teacher, config, teacher_acts=k == 0)
        new = [sample_rows(torch.from_numpy(x), actors.parameters) for x in collected]
        n_new = new[0].shape[1]
        if k == 0:  # memory for all rounds: they are too large to be copied
            data = [x.new_empty(len(x), config.n_rounds * n_new, x.shape[2]) for x in new]
        for samples, x in zip(data, new, strict=True):
            samples[:, k * n_new : (k + 1) * n_new] = x
        n_known = (k + 1) * n_new
        n_taken = min(config.n_passes * n_known, config.max_samples)
        errors.append(_regress(actors, optimizer, generators, data, n_known, n_taken, config))
    for index in range(config.final_passes):
        slower = replace(config, learning_rate=config.learning_rate * 0.5 ** (index + 1))
        errors[-1] = _regress(actors, optimizer, generators, data, n_known, n_known, slower)
    return errors


def _collect(
    actors: Actors,
    worlds: Worlds,
    generators: Sequence[np.random.Generator],
    teacher: Teacher,
    config: CloneConfig,
    *,
    teacher_acts: bool,
) -> tuple[Float, Float]:
    """Actor inputs and the teacher's actions, [T, K, E, N, I] and [T, K, E, N, A]."""
    all_inputs, labels = [], []
    for _ in range(config.rollout_steps):
        step = worlds.current_step
        inputs = actors.inputs(worlds.observations(step))
        label = worlds.to_local(step, teacher.act(step)).astype(np.float32)
        all_inputs.append(inputs.numpy())
        labels.append(label)
        means = label if teacher_acts else actors.means(inputs).numpy()
        noise = standard_normal(generators, means.shape[1:])
        next_step = worlds.advance(means + np.float32(config.noise) * noise)
        ended = np.flatnonzero(next_step.ended)
        if len(ended):
            teacher.reset(worlds.current_step, ended)
    return np.stack(all_inputs), np.stack(labels)


def _regress(
    actors: Actors,
    optimizer: StackedAdam,
    generators: Sequence[np.random.Generator],
    data: Sequence[Tensor],
    n_known: int,
    n_taken: int,
    config: CloneConfig,
) -> Tensor:
    """Takes `n_taken` of the first `n_known` samples, all before any again; mean errors, [K]."""
    total, taken = torch.zeros(len(generators)), 0
    orders = (minibatches(generators, n_known, actors.n_rows, config.minibatch) for _ in count())
    for rows in chain.from_iterable(orders):
        inputs, labels = (pick(x, rows) for x in data)
        loss = seed_means(
            (actors.again(inputs[:, :, None]) - labels).square().mean(-1), len(generators)
        )
        optimizer.step(loss, config.learning_rate)
        total += loss.detach() * rows.shape[1]
        taken += rows.shape[1]
        if taken >= n_taken:
            break
    return total / taken
