"""Clones a teacher into actors, so that training starts from a careful driver.

DAgger, as `online_algos.dagger` has it, with beta = 1 in the first round and 0 after.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.learn.networks.optimizer import Descent
from swarmdata.online_algos.actors.mean_actors import Actors
from swarmdata.online_algos.actors.sample_rows import minibatches, pick, sample_rows, seed_means
from swarmdata.online_algos.collection.training_worlds import Worlds, standard_normal
from swarmdata.online_algos.imitation.labelled_states import LabelledStates
from swarmdata.types import Float, Int, Step


class Teacher(Protocol):
    """What is cloned: policies, and teams that are only needed for labels."""

    def reset(self, step: Step, copies: Int) -> None: ...

    def act(self, step: Step) -> Float: ...


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
    descent = Descent({"actor": actors.network}, len(generators), 1.0, None)
    worlds.restart()
    teacher.reset(worlds.current_step, np.arange(worlds.env.n_copies))
    errors = []
    for k in tqdm(range(config.n_rounds), desc="cloning the teacher", unit="round", disable=None):
        new = collect(
            actors, worlds, generators, teacher, config.rollout_steps, config.noise,
            teacher_acts=k == 0,
        )  # fmt: skip
        if k == 0:
            data = LabelledStates(
                [x.new_empty(len(x), config.n_rounds * x.shape[1], x.shape[2]) for x in new]
            )
        data.append(new)
        n_taken = min(config.n_passes * len(data), config.max_samples)
        size, rate = config.minibatch, config.learning_rate
        errors.append(regress(actors, descent, generators, data, n_taken, size, rate))
    for _ in range(config.final_passes):
        rate *= 0.5
        errors[-1] = regress(actors, descent, generators, data, len(data), size, rate)
    return errors


def collect(
    actors: Actors, worlds: Worlds, generators: Sequence[np.random.Generator], teacher: Teacher,
    n_steps: int, noise: float, *, teacher_acts: bool,
) -> list[Tensor]:  # fmt: skip
    """Lets actors, or the teacher, act for `n_steps` of every copy; the teacher labels each step.

    The teacher was reset when the running episodes began. Actions are taken with noise of a
    deviation, by a generator for each of K seeds. Returns inputs of the actors, [R, samples, I],
    and actions of the teacher, [R, samples, A].
    """
    all_inputs, labels = [], []
    for _ in range(n_steps):
        step = worlds.current_step
        inputs = actors.inputs(worlds.observations(step))
        label = worlds.to_local(step, teacher.act(step)).astype(np.float32)
        all_inputs.append(inputs.numpy())
        labels.append(label)
        means = label if teacher_acts else actors.means(inputs).numpy()
        errors = standard_normal(generators, means.shape[1:])
        next_step = worlds.advance(means + np.float32(noise) * errors)
        ended = np.flatnonzero(next_step.ended)
        if len(ended):
            teacher.reset(worlds.current_step, ended)
    both = (np.stack(all_inputs), np.stack(labels))  # [T, K, E, N, I] and [T, K, E, N, A]
    return [sample_rows(torch.from_numpy(x), actors.parameters) for x in both]


def regress(
    actors: Actors, descent: Descent, generators: Sequence[np.random.Generator],
    data: LabelledStates, n_taken: int, minibatch: int, learning_rate: float,
) -> Tensor:  # fmt: skip
    """Fits actors to labels; returns the mean errors, [K]; takes all samples before any again.

    The descent's own learning rate is 1. In all, `n_taken` samples are taken, `minibatch` in a
    gradient step, in the order of a generator for each seed.
    """
    n_seeds = len(generators)
    total, taken = torch.zeros(n_seeds), 0
    orders = (minibatches(generators, len(data), actors.n_rows, minibatch) for _ in count())
    for rows in chain.from_iterable(orders):
        inputs, labels = (pick(x, rows) for x in data.arrays)
        errors = (actors.again(inputs[:, :, None]) - labels).square().mean(-1)
        loss = seed_means(errors, n_seeds)
        descent.step(loss, learning_rate)
        total += loss.detach() * rows.shape[1]
        taken += rows.shape[1]
        if taken >= n_taken:
            break
    return total / taken
