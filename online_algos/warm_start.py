"""Clones a teacher into MAPPO's actor, so that training starts from a careful driver.

Source: DAgger, Ross, Gordon and Bagnell, "A reduction of imitation learning and structured
prediction to no-regret online learning", AISTATS 2011, algorithm 3.1, with beta = 1 in the first
round and 0 after. The learner drives with noise, so that the teacher's corrections are seen.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.interfaces import Policy
from swarmdata.online_algos.mappo import MAPPO
from swarmdata.types import Float


@dataclass(frozen=True)
class Config:
    """Rounds of collection and regression."""

    n_rounds: int = 10
    n_steps: int = 256  # per round and copy
    n_passes: int = 2  # over all data so far, per round
    final_passes: int = 4
    minibatch: int = 2048
    learning_rate: float = 1e-3
    noise: float = 0.1  # standard deviation, while the learner drives


def warm_start(run: MAPPO, teacher: Policy, config: Config) -> list[float]:
    """Fits the run's actor to the teacher; returns the mean squared error after each round.

    Args:
        run: a MAPPO run before its first update; its actor is trained in place.
        teacher: labels the states that the learner meets.
        config: how much.
    """
    optimizer = torch.optim.Adam(run.actor.parameters(), lr=config.learning_rate, fused=True)
    seen: list[Tensor] = []
    labels: list[Tensor] = []
    errors = []
    for k in range(config.n_rounds):
        inputs, actions = _collect(run, teacher, config, teacher_drives=k == 0)
        seen.append(torch.from_numpy(inputs))
        labels.append(torch.from_numpy(actions))
        last = k == config.n_rounds - 1
        n_passes = config.n_passes + (config.final_passes if last else 0)
        data, targets = torch.cat(seen), torch.cat(labels)
        for index in range(n_passes):
            decay = 0.5 ** max(0, index - config.n_passes + 1)
            error = _regress(run, optimizer, data, targets, config.learning_rate * decay, config)
        errors.append(error)
    return errors


def _collect(
    run: MAPPO, teacher: Policy, config: Config, *, teacher_drives: bool
) -> tuple[Float, Float]:
    """Actor inputs and the teacher's actions, [samples, O + N] and [samples, A]."""
    run.restart_worlds()
    step = run.present
    teacher.reset(step, np.arange(run.env.n_copies))
    inputs, actions = [], []
    for _ in range(config.n_steps):
        own = run.inputs(step)[0]
        label = teacher.act(step)
        inputs.append(own)
        actions.append(label)
        with torch.inference_mode():
            drive = label if teacher_drives else run.actor(torch.from_numpy(own)).numpy()
        noise = run.generator.standard_normal(drive.shape, dtype=np.float32)
        reached, step = run.advance(drive + np.float32(config.noise) * noise)
        ended = np.flatnonzero(reached.ended)
        if len(ended):
            teacher.reset(step, ended)
    flat = [np.concatenate(x).reshape(-1, x[0].shape[-1]) for x in (inputs, actions)]
    return flat[0], flat[1]


def _regress(
    run: MAPPO,
    optimizer: torch.optim.Optimizer,
    data: Tensor,
    targets: Tensor,
    learning_rate: float,
    config: Config,
) -> float:
    """One pass of mean squared error; returns its mean."""
    for group in optimizer.param_groups:
        group["lr"] = learning_rate
    order = torch.from_numpy(run.generator.permutation(len(data)))
    total = 0.0
    for rows in torch.split(order, config.minibatch):
        loss = (run.actor(data[rows]) - targets[rows]).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        total += loss.item() * len(rows)
    return total / len(data)
