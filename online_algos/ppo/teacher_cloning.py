"""Clones a teacher into MAPPO's actors, so that training starts from a careful driver.

Source: DAgger, Ross, Gordon and Bagnell, "A reduction of imitation learning and structured
prediction to no-regret online learning", AISTATS 2011, algorithm 3.1, with beta = 1 in the first
round and 0 after. The learner drives with noise, so that the teacher's corrections are seen.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.errors import SpecError
from swarmdata.interfaces import Policy
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.online_algos.collection.seed_generators import standard_normal
from swarmdata.online_algos.ppo.rollout_samples import minibatches, pick, sample_rows, seed_means
from swarmdata.types import Float

if TYPE_CHECKING:
    from swarmdata.online_algos.mappo import MAPPO


@dataclass(frozen=True)
class CloneConfig:
    """Rounds of collection and regression."""

    n_rounds: int = 10
    n_steps: int = 256  # per round and copy
    n_passes: int = 2  # over all data so far, per round
    max_samples: int = 1_500_000  # robot samples that the passes of a round may take together
    final_passes: int = 4  # more after the last round, the step size halved in each
    minibatch: int = 2048  # robot samples
    learning_rate: float = 1e-3
    noise: float = 0.1  # standard deviation, while the learner drives


def clone_teacher(run: "MAPPO", teacher: Policy, config: CloneConfig) -> list[Tensor]:
    """Fits the actors to a teacher; returns the mean squared errors after each round, each [K].

    Args:
        run: before its first update; its actors are trained in place, its worlds are left in the
            midst of episodes.
        teacher: labels the states that the learners meet.
        config: how much.

    Raises:
        SpecError: there is no round, or the noise is no standard deviation.
    """
    if config.n_rounds < 1:
        raise SpecError(f"clone_rounds is {config.n_rounds}, expected at least 1")
    if not 0.0 <= config.noise < math.inf:
        raise SpecError(f"clone_noise is {config.noise:g}, expected a number that is not negative")
    optimizer = StackedAdam(run.actor, len(run.generators), 1.0)
    errors, parameters = [], run.config.parameters
    for k in tqdm(range(config.n_rounds), desc="cloning the teacher", unit="round", disable=None):
        collected = _collect(run, teacher, config, teacher_drives=k == 0)
        new = [sample_rows(torch.from_numpy(x), parameters) for x in collected]
        each = new[0].shape[1]
        if k == 0:  # room for all rounds: they are too large to be copied
            data = [x.new_empty(len(x), config.n_rounds * each, x.shape[2]) for x in new]
        for place, x in zip(data, new, strict=True):
            place[:, k * each : (k + 1) * each] = x
        present = (k + 1) * each
        wanted = min(config.n_passes * present, config.max_samples)
        errors.append(_regress(run, optimizer, data, present, wanted, config))
    for index in range(config.final_passes):
        halved = replace(config, learning_rate=config.learning_rate * 0.5 ** (index + 1))
        errors[-1] = _regress(run, optimizer, data, present, present, halved)
    return errors


def _collect(
    run: "MAPPO", teacher: Policy, config: CloneConfig, *, teacher_drives: bool
) -> tuple[Float, Float]:
    """Actor inputs and the teacher's actions, [T, K, E, N, O + N] and [T, K, E, N, A]."""
    worlds, everyone = run.worlds, np.arange(run.worlds.env.n_copies)
    worlds.restart()
    teacher.reset(worlds.present, everyone)
    inputs, actions = [], []
    for _ in range(config.n_steps):
        now = worlds.present
        if not run.config.teacher_remembers:
            teacher.reset(now, everyone)
        own = run.inputs(worlds.seen(now))
        label = worlds.to_local(now, teacher.act(now)).astype(np.float32)
        inputs.append(own.numpy())
        actions.append(label)
        drive = label if teacher_drives else run.means(own).numpy()
        noise = standard_normal(run.generators, drive.shape[1:])
        reached = worlds.advance(drive + np.float32(config.noise) * noise)
        ended = np.flatnonzero(reached.ended)
        if len(ended):
            teacher.reset(worlds.present, ended)
    return np.stack(inputs), np.stack(actions)


def _regress(
    run: "MAPPO",
    optimizer: StackedAdam,
    data: Sequence[Tensor],
    present: int,
    wanted: int,
    config: CloneConfig,
) -> Tensor:
    """Takes samples in random order, all before any again.

    Args:
        run: whose actors are trained.
        optimizer: of the actors.
        data: inputs and labels, each [K or K N, M, ...].
        present: of the M samples, those that are there.
        wanted: samples to take; the last minibatch is a whole one.
        config: step size and size of minibatches.

    Returns:
        Their mean squared error, [K].
    """
    total, taken = torch.zeros(len(run.generators)), 0
    orders = (minibatches(run.generators, present, run.n_rows, config.minibatch) for _ in count())
    for rows in chain.from_iterable(orders):
        own, labels = (pick(x, rows) for x in data)
        errors = (run.actor(own) - labels).square().mean(-1)
        loss = seed_means(errors, len(run.generators))
        optimizer.step(loss, config.learning_rate)
        total += loss.detach() * rows.shape[1]
        taken += rows.shape[1]
        if taken >= wanted:
            break
    return total / taken
