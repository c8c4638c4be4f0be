"""An estimate with its interval, the bootstrap over rows, and Wilson's interval of a rate."""

from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.types import Double

LEVEL = 0.95  # confidence level of all intervals
MAX_RESAMPLED_SCORES = 1 << 22  # most resampled scores that are in memory at once


def mean(scores: Double) -> Double:
    """The mean over runs and tasks; `scores[..., runs, tasks] -> [...]`."""
    return np.asarray(scores.mean(axis=(-2, -1)))


class Estimate(NamedTuple):
    """A value and the bounds of its confidence interval."""

    value: float
    low: float
    high: float


def bootstrap(
    statistic: Callable[..., Double],
    scores: Double,
    *,
    generator: np.random.Generator,
    n_resamples: int = 2000,
) -> Estimate:
    """Stratified percentile bootstrap, for statistics that `score_intervals` has no model of.

    A resample of scores, finite [runs, tasks], draws, independently for every task, as many runs as
    there are, with replacement; tasks are not resampled (Agarwal et al., "Deep Reinforcement
    Learning at the Edge of the Statistical Precipice", NeurIPS 2021, section 4.1). The bounds are
    the (1 - `LEVEL`) / 2 and (1 + `LEVEL`) / 2 quantiles of the statistic, which maps [..., runs,
    tasks] to [...], over resamples, linearly interpolated (Efron and Tibshirani, "An Introduction
    to the Bootstrap", 1993, section 13.3).
    """
    if scores.ndim != 2 or not scores.size or not np.isfinite(scores).all():
        raise SchemaError(
            f"scores are {list(scores.shape)} with {int((~np.isfinite(scores)).sum())} values "
            "that are not finite, expected finite [runs, tasks] with at least one of each."
        )
    size = max(1, MAX_RESAMPLED_SCORES // scores.size)
    chunks = [min(size, n_resamples - start) for start in range(0, n_resamples, size)]
    tasks = np.arange(scores.shape[1])
    draws = [
        statistic(scores[generator.integers(len(scores), size=(n, *scores.shape)), tasks])
        for n in chunks
    ]
    tail = (1.0 - LEVEL) / 2.0
    low, high = np.quantile(np.concatenate(draws), [tail, 1.0 - tail])
    return Estimate(float(statistic(scores)), float(low), float(high))


def wilson_interval(n_successes: float, n_episodes: int) -> Estimate:
    """Returns the success rate with its Wilson score interval, which is accurate near 0 and 1 too.

    A mean over seeds of the number of successes need not be whole.

    (Wilson, JASA 22:209, 1927; recommended by Brown, Cai and DasGupta, "Interval Estimation for a
    Binomial Proportion", Statistical Science 16:2, 2001.)
    """
    if not 0 <= n_successes <= n_episodes or n_episodes == 0:
        raise SchemaError(
            f"{n_successes} successes in {n_episodes} episodes, "
            "expected 0 <= successes <= episodes and at least one episode."
        )
    z = NormalDist().inv_cdf((1.0 + LEVEL) / 2.0)
    rate, shrink = n_successes / n_episodes, z * z / n_episodes
    center = (rate + shrink / 2.0) / (1.0 + shrink)
    margin = (z / (1.0 + shrink)) * np.sqrt(
        rate * (1.0 - rate) / n_episodes + shrink / (4.0 * n_episodes)
    )
    low = 0.0 if n_successes == 0 else float(center - margin)  # exact, without rounding noise
    high = 1.0 if n_successes == n_episodes else float(center + margin)
    return Estimate(rate, low, high)
