"""Action noise that depends on the episode, the time and the robot only; controllers with it."""

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from swarmdata.errors import SchemaError, SpecError
from swarmdata.numerics.random import STREAMS, derive, normal
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step


def counters(step: Step, stream: str, n_agents: int, n_values: int) -> Seeds:
    """Returns independent 64-bit values for every copy, robot and value, [E, N, n_values].

    They are a function of `step.seeds` and `step.times` alone, so an episode draws the same values
    in any batch. `stream` is a name in `random.STREAMS`.
    """
    agents = np.arange(n_agents, dtype=np.uint64)[:, None]
    values = np.arange(n_values, dtype=np.uint64)
    seeds, times = step.seeds[:, None, None], step.times[:, None, None]
    return derive(seeds, STREAMS[stream], times.astype(np.uint64), agents, values)


def check_noise(noise: float) -> float:
    """Returns `noise` as a float if it is a standard deviation; else raises a `SpecError`."""
    if not (isinstance(noise, int | float | np.floating) and 0.0 <= noise < math.inf):
        raise SpecError(
            f"action noise is {noise!r}, expected a finite standard deviation >= 0. "
            "Actions lie in [-1, 1], so useful values are below 1."
        )
    return float(noise)


def add_noise(actions: Double, step: Step, noise: float) -> Double:
    """Returns `actions` [E, N, A] plus Gaussian noise, clipped to [-1, 1].

    `noise` is its standard deviation; 0 only clips.
    """
    if noise > 0.0:
        _, n_agents, size = actions.shape
        actions = actions + noise * normal(counters(step, "noise", n_agents, size))
    return np.clip(actions, -1.0, 1.0)


class Controller(ABC):
    """A scripted policy: commands of all robots with noise, and zeros for messages.

    Args:
        spec: the task.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: `noise` is not a standard deviation.
    """

    uses_state = True
    has_memory: ClassVar[bool] = True  # whether commands depend on more than the step

    def __init__(self, spec: TaskSpec, noise: float = 0.0) -> None:
        self._noise, self._action_size = check_noise(noise), spec.action_size
        self._last = LastMeans[Double]()
        self._seeds: Seeds = np.zeros(0, dtype=np.uint64)  # of the episodes that have begun, [E]
        self._has_begun: Bool = np.zeros(0, dtype=np.bool_)

    @abstractmethod
    def commands(self, step: Step) -> Double:
        """Returns the commands of all robots without noise, [E, N, 2]."""

    def reset(self, step: Step, copies: Int) -> None:
        """Notes which episodes begin in `copies`; what those with a memory extend."""
        if len(step.seeds) != len(self._seeds):
            self._seeds = np.zeros_like(step.seeds)
            self._has_begun = np.zeros(len(step.seeds), dtype=np.bool_)
        self._seeds[copies], self._has_begun[copies] = step.seeds[copies], True

    def act(self, step: Step) -> Float:
        if self.has_memory and not (
            self._has_begun.all() and np.array_equal(self._seeds, step.seeds)
        ):
            raise SchemaError(
                "the scripted policy was not told of some episodes of this step. Call "
                "policy.reset(step, copies) whenever the environment resets copies."
            )
        commands = self._last.keep(step, self.commands(step))
        actions = np.zeros((*commands.shape[:2], self._action_size), dtype=np.float32)
        actions[..., :2] = add_noise(commands, step, self._noise)
        return actions

    def log_probs(self, step: Step, actions: Float) -> Float:
        commands = self._last.recall(step)
        if commands is None:
            commands = self._last.require(step) if self.has_memory else self.commands(step)
        return noisy_log_probs(commands, actions, self._noise)
