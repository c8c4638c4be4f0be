"""Clones a teacher into MAPPO's actors, so that training starts from a careful driver.

Source: DAgger, Ross, Gordon and Bagnell, "A reduction of imitation learning and structured
prediction to no-regret online learning", AISTATS 2011, algorithm 3.1, with beta = 1 in the first
round and 0 after. The learner drives with noise, so that the teacher's corrections are seen.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.interfaces import Policy
from swarmdata.learn.optimizer import StackedAdam
from swarmdata.online_algos.generators import standard_normal
from swarmdata.online_algos.rollouts import minibatches, pick, sample_rows, seed_means
from swarmdata.types import Float

if TYPE_CHECKING:
    from swarmdata.online_algos.mappo import MAPPO


@dataclass(frozen=True)
class CloneConfig:
    """Rounds of collection and regression."""

    n_rounds: int = 10
    n_steps: int = 256  # per round and copy
    n_passes: int = 2  # over all data so far, per round
    final_passes: int = 4  # more in the last round, the step size halved in each
    minibatch: int = 2048  # robot samples
    learning_rate: float = 1e-3
    noise: float = 0.1  # standard deviation, while the learner drives


def clone_teacher(run: "MAPPO", teacher: Policy, config: CloneConfig) -> list[Tensor]:
    """Fits the actors to a teacher; returns the mean squared errors after each round, each [K].

    Args:
        run: before its first update; its actors are trained in place.
        teacher: labels the states that the learners meet.
        config: how much.
    """
    optimizer = StackedAdam(run.actor, len(run.generators), 1.0)
    seen: list[Tensor] = []
    labels: list[Tensor] = []
    errors = []
    for k in tqdm(range(config.n_rounds), desc="cloning the teacher", unit="round", disable=None):
        own, actions = _collect(run, teacher, config, teacher_drives=k == 0)
        seen.append(sample_rows(torch.from_numpy(own), run.config.parameters))
        labels.append(sample_rows(torch.from_numpy(actions), run.config.parameters))
        n_passes = config.n_passes + (config.final_passes if k == config.n_rounds - 1 else 0)
        data, targets = torch.cat(seen, 1), torch.cat(labels, 1)
        for index in range(n_passes):
            step = config.learning_rate * 0.5 ** max(0, index - config.n_passes + 1)
            error = _regress(run, optimizer, data, targets, step, config.minibatch)
        errors.append(error)
    run.worlds.restart()
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
    data: Tensor,
    targets: Tensor,
    learning_rate: float,
    minibatch: int,
) -> Tensor:
    """One pass of mean squared error; returns its mean, [K]."""
    total, n_samples = torch.zeros(len(run.generators)), data.shape[1]
    for rows in minibatches(run.generators, n_samples, run.n_rows, minibatch):
        errors = (run.actor(pick(data, rows)) - pick(targets, rows)).square().mean(-1)
        loss = seed_means(errors, len(run.generators))
        optimizer.step(loss, learning_rate)
        total += loss.detach() * rows.shape[1]
    return total / n_samples
