"""The definition and computation of a dataset's `log_probs`.

The log-probability of a robot's action is the sum over its components of

- the log-density of the normal N(mean, noise^2), for a component strictly inside (-1, 1);
- the log of the normal's mass beyond a bound, for a component at that bound, where noisy actions
  are clipped;
- for a component without noise, 0 if it is the one chosen, else -infinity;
- -log 2 for a uniform draw from [-1, 1].

All of it is computed elementwise in float64 (`exact_math`) from the stored float32 action, and
rounded once to float32, so that it has the same bits on every platform and in every batch.
"""

from typing import Generic, TypeVar

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.exact_math import HALF_LOG_TWO_PI, log, log_tail
from swarmdata.types import Double, Float, Step

LOG_2 = 0.6931471805599453094


def noisy_log_probs(means: Double, actions: Float, noise: float) -> Float:
    """Returns the log-probability of each robot's action, [E, N].

    Means, without noise and not rounded, are [E, N, C], actions, clipped to [-1, 1], [E, N, A];
    components beyond C (messages that the policy never sends) are zero with certainty. `noise` is
    the standard deviation of the Gaussian noise; 0 for a deterministic policy.
    """
    size = means.shape[-1]
    driven = actions[..., :size]
    if noise > 0.0:
        parts = _normal(means, driven.astype(np.float64), noise)
    else:
        parts = _certain(np.clip(means, -1.0, 1.0).astype(np.float32), driven)
    return _joint(np.concatenate([parts, _certain(np.float32(0.0), actions[..., size:])], axis=-1))


def certain_log_probs(chosen: Float, actions: Float) -> Float:
    """Returns the log-probability of each robot's action under a policy without noise, [E, N].

    The policy's actions, [E, N, C], may lie outside [-1, 1] if they are choices; of those taken,
    [E, N, A], components beyond C are zero with certainty.
    """
    size = chosen.shape[-1]
    is_taken = (actions[..., :size] == chosen).all(-1)
    if actions.shape[-1] > size:
        is_taken &= (actions[..., size:] == 0).all(-1)
    return np.where(is_taken, np.float32(0.0), np.float32(-np.inf))


def uniform_log_probs(actions: Float) -> Float:
    """Returns the log-probability of actions drawn uniformly from [-1, 1]^A, [E, N]."""
    return _joint(np.where(np.abs(actions) <= 1.0, -LOG_2, -np.inf))


def _normal(means: Double, actions: Double, noise: float) -> Double:
    """Log-densities inside the bounds, log-masses at them, -infinity outside; [E, N, C]."""
    distances = (actions - means) / noise
    log_scale = log(np.array(noise)) + HALF_LOG_TWO_PI
    parts = -0.5 * distances * distances - log_scale
    at_bound = np.abs(actions) >= 1.0
    if at_bound.any():
        outward = np.where(actions > 0.0, distances, -distances)[at_bound]
        impossible = np.abs(actions[at_bound]) > 1.0
        parts[at_bound] = np.where(impossible, -np.inf, log_tail(outward))
    return parts


def _certain(chosen: Float | np.float32, actions: Float) -> Double:
    return np.where(actions == chosen, 0.0, -np.inf)


def _joint(parts: Double) -> Float:
    """Sums over components in order, then rounds once."""
    total = np.zeros(parts.shape[:-1])
    for component in range(parts.shape[-1]):
        total = total + parts[..., component]
    return total.astype(np.float32)


M = TypeVar("M", bound=Float | Double)


class LastMeans(Generic[M]):
    """A policy's noiseless actions on the step it acted on last, identified by the step object.

    A policy with memory cannot act on a step twice to compute the log-probability of its action.
    """

    def __init__(self) -> None:
        self._step: Step | None = None
        self._means: M | None = None

    def keep(self, step: Step, means: M) -> M:
        """Stores and returns the means of a step, [E, N, C]."""
        self._step, self._means = step, means
        return means

    def recall(self, step: Step) -> M | None:
        """Returns the means of `step` if it is the last one stored, else None."""
        return self._means if step is self._step else None

    def require(self, step: Step) -> M:
        """Returns the means of `step`, [E, N, C]."""
        if step is not self._step or self._means is None:
            raise SchemaError(
                "log_probs got another step than the last call of act, expected the same object: a "
                "policy with memory cannot act on a step twice. Call act(step), then "
                "log_probs(step, actions), in the order of the episode."
            )
        return self._means
