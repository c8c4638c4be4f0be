"""Gaussian action noise that depends on the episode, the time and the robot only."""

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.numerics.random import STREAMS, derive, normal
from swarmdata.types import Double, Seeds, Step


def counters(step: Step, stream: str, n_agents: int, n_values: int) -> Seeds:
    """Returns independent 64-bit values for every copy, robot and value, [E, N, n_values].

    They are a function of `step.seeds` and `step.times` alone, so an episode draws the same values
    in any batch.

    Args:
        step: the current step; its `seeds` and `times` are read.
        stream: a name in `seeding.STREAMS`.
        n_agents: N.
        n_values: how many values each robot needs in one step.
    """
    agents = np.arange(n_agents, dtype=np.uint64)[:, None]
    values = np.arange(n_values, dtype=np.uint64)
    seeds, times = step.seeds[:, None, None], step.times[:, None, None]
    return derive(seeds, STREAMS[stream], times.astype(np.uint64), agents, values)


def check_noise(noise: float) -> float:
    """Returns `noise` if it is a standard deviation.

    Raises:
        SpecError: it is negative, infinite or NaN.
    """
    if not 0.0 <= noise < float("inf"):
        raise SpecError(
            f"action noise is {noise!r}, expected a finite standard deviation >= 0. "
            "Actions lie in [-1, 1], so useful values are below 1."
        )
    return float(noise)


def add_noise(actions: Double, step: Step, noise: float) -> Double:
    """Returns `actions` plus Gaussian noise, clipped to [-1, 1], [E, N, A].

    Args:
        actions: mean actions, [E, N, A].
        step: the step they answer.
        noise: standard deviation; 0 only clips.
    """
    if noise > 0.0:
        _, n_agents, size = actions.shape
        actions = actions + noise * normal(counters(step, "noise", n_agents, size))
    return np.clip(actions, -1.0, 1.0)
