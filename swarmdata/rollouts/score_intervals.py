"""Intervals of means over training seeds and episodes, and of differences of such means.

Tables are [K seeds, E episodes] in any unit, which the intervals share: every training seed plays
the same E episodes. docs/evaluation.md says what the intervals are for, and their coverage.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_statistics import LEVEL, Estimate, wilson_interval
from swarmdata.types import Double

Bounds = tuple[float, float]
"""The smallest and the largest value that a quantity can have, in the unit of its table."""

UNBOUNDED: Bounds = (-math.inf, math.inf)
AT_LEAST_ZERO: Bounds = (0.0, math.inf)  # of counts and durations

SHARE: Bounds = (0.0, 1.0)

TARGET_OF_SEVERAL = "new training seeds and new episodes of the same distribution"
"""What the interval of several seeds is for."""

TARGET_OF_ONE = "the measured policy on new episodes of the same distribution"
"""What the interval of one seed is for."""


def mean_interval(values: Double, *, bounds: Bounds = UNBOUNDED) -> Estimate:
    """Returns the mean of values [K, E] over seeds and episodes with its interval.

    Values may be differences of the same policies on the same episodes. The interval ends at their
    bounds, which leaves its coverage as it is.
    """
    return _within(bounds, combination_interval([values], [1.0]))


def _within(bounds: Bounds, found: Estimate) -> Estimate:
    """Ends an interval at the bounds of its quantity; undefined ends (NaN) stay so."""
    return Estimate(found.value, max(found.low, bounds[0]), min(found.high, bounds[1]))


def difference_interval(x: Double, y: Double) -> Estimate:
    """Returns the mean of `x` minus that of `y` on the same episodes, with its interval.

    What an episode does to both, [K, E] and [J, E], cancels; the seeds of both count.
    """
    return combination_interval([x, y], [1.0, -1.0])


def combination_interval(tables: Sequence[Double], weights: Sequence[float]) -> Estimate:
    """Returns a weighted sum of means with its interval: of a difference, or an average.

    The variances are those of the two-way random-effects model, seeds by episodes (Searle, Casella
    and McCulloch, "Variance Components", 1992, section 4.3), the degrees of freedom Satterthwaite's
    ("An Approximate Distribution of Estimates of Variance Components", Biometrics Bulletin 2:110,
    1946). The half-width is t_nu sqrt(V). With weights w, seed means of variance s^2, and Z the sum
    of the tables' means over seeds, weighted by w, on each episode,

        V = sum_g w_g^2 s_g^2 / K_g + max(c, 0) / E
        c = var(Z) - sum_g w_g^2 (var(mean_g) - c_g)
        c_g = (K_g var(mean_g) - mean variance of one seed over episodes) / (K_g - 1)
        nu = V^2 / sum of (component^2 / its degrees of freedom, K_g - 1 or E - 1)

    where c_g is the mean covariance of two different seeds. If a table has one seed, the variation
    between its seeds is unknown, and the interval is for the measured policies on new episodes:
    V = var(Z) / E with E - 1 degrees of freedom. With one episode, there is no interval (NaN).

    Args:
        tables: finite, [K_g, E] with the same episodes in all.
        weights: of their means.

    Raises:
        SchemaError: a table is not finite, or the tables differ in episodes.
    """
    _check(tables)
    value = math.fsum(w * float(x.mean()) for w, x in zip(weights, tables, strict=True))
    n_episodes = tables[0].shape[1]
    if n_episodes == 1:
        return Estimate(value, math.nan, math.nan)
    total = sum(w * x.mean(axis=0) for w, x in zip(weights, tables, strict=True))
    shared = float(np.var(total, ddof=1))
    components = []  # each a variance and its degrees of freedom
    if all(len(x) > 1 for x in tables):
        for weight, x in zip(weights, tables, strict=True):
            k = len(x)
            components.append((weight**2 * float(x.mean(axis=1).var(ddof=1)) / k, k - 1))
            shared -= weight**2 * _own_share(x)
    components.append((max(shared, 0.0) / n_episodes, n_episodes - 1))
    variance = sum(part for part, _ in components)
    if variance <= 0.0:
        return Estimate(value, value, value)
    df = variance**2 / sum(part**2 / part_df for part, part_df in components)
    half = t_quantile((1.0 + LEVEL) / 2.0, df) * math.sqrt(variance)
    return Estimate(value, value - half, value + half)


def _own_share(x: Double) -> float:
    """Variance over episodes of the mean of K > 1 seeds that is not common to them: var - c."""
    k = len(x)
    own, common = float(x.var(axis=1, ddof=1).mean()), float(x.mean(axis=0).var(ddof=1))
    return (own - common) / (k - 1)


def _check(tables: Sequence[Double]) -> None:
    shapes = [list(x.shape) for x in tables]
    n_undefined = sum(int((~np.isfinite(x)).sum()) for x in tables)
    is_same = all(len(shape) == 2 and shape[1] == shapes[0][-1] for shape in shapes)
    if not is_same or n_undefined or not all(x.size for x in tables):
        raise SchemaError(
            f"scores are {shapes} with {n_undefined} values that are not finite, expected finite "
            "[seeds, episodes] with the same episodes and at least one of each."
        )


def rate_interval(outcomes: Double) -> Estimate:
    """Returns the share of episodes with its interval, between 0 and 1, of outcomes 0 or 1, [K, E].

    Of one seed it is Wilson's. So it is where the variances are 0, as without a failure, or with
    one success of each seed in another episode: E episodes count, as if seeds always agreed.
    """
    found = mean_interval(outcomes, bounds=SHARE)
    if len(outcomes) > 1 and not math.isclose(found.low, found.high):
        return found
    return wilson_interval(outcomes.sum() / len(outcomes), outcomes.shape[1])


RARE = 5
"""Of successes or failures of all seeds: with so few, variances between seeds say little."""


def rare_rate_interval(outcomes: Double) -> Estimate:
    """As `rate_interval`, but with few successes or failures it is at least as wide as Wilson's.

    Few are at most `RARE`. Wilson's is that of E episodes, as if seeds always agreed. Without it,
    one failure of five seeds would have a shorter interval than none.

    Args:
        outcomes: 0 or 1, [K, E].

    Raises:
        SchemaError: the table is not finite, or not [seeds, episodes].
    """
    found, n_successes = rate_interval(outcomes), float(outcomes.sum())
    if min(n_successes, outcomes.size - n_successes) > RARE:
        return found
    least = wilson_interval(n_successes / len(outcomes), outcomes.shape[1])
    return Estimate(found.value, min(found.low, least.low), max(found.high, least.high))


def rate_difference_interval(x: Double, y: Double) -> Estimate:
    """As `difference_interval` of outcomes, but where the differences do not vary, it has a width.

    It is then that of the two rates' own intervals (Newcombe, "Interval Estimation for the
    Difference Between Independent Proportions", Statistics in Medicine 17:873, 1998, method 10).

    Args:
        x: 0 or 1, [K, E].
        y: those that are subtracted, [J, E].

    Raises:
        SchemaError: a table is not finite, or the tables differ in episodes.
    """
    found = difference_interval(x, y)
    if found.low < found.high or math.isnan(found.low):
        return found
    own, other = rare_rate_interval(x), rare_rate_interval(y)
    below = math.hypot(own.value - own.low, other.high - other.value)
    above = math.hypot(own.high - own.value, other.value - other.low)
    return Estimate(found.value, max(found.value - below, -1.0), min(found.value + above, 1.0))


def count_interval(counts: Double) -> Estimate:
    """Returns the mean of counts [K, E] with its interval, which has a width without events too.

    If no episode of any seed has an event, all variances are 0. The upper end is then Garwood's
    exact limit of a Poisson mean, -ln((1 - `LEVEL`) / 2) / E = 3.69 / E ("Fiducial Limits for the
    Poisson Distribution", Biometrika 28:437, 1936), where E episodes count, as if seeds always
    agreed. It is too low if events come in bursts.
    """
    found = mean_interval(counts, bounds=AT_LEAST_ZERO)
    if counts.any() or math.isnan(found.high):
        return found
    return found._replace(high=-math.log((1.0 - LEVEL) / 2.0) / counts.shape[1])


def seed_interval(means: Double, *, bounds: Bounds = UNBOUNDED) -> Estimate:
    """Returns the mean over seeds with Student's t interval, for new seeds on the same episodes.

    For curves, of which only means over episodes are kept, [K]. One seed has none (NaN).
    """
    k, value = len(means), float(means.mean())
    if k == 1:
        return Estimate(value, math.nan, math.nan)
    error = math.sqrt(float(means.var(ddof=1)) / k)
    half = t_quantile((1.0 + LEVEL) / 2.0, k - 1) * error
    return _within(bounds, Estimate(value, value - half, value + half))


def target_of(n_seeds: Sequence[int]) -> str:
    """Says what intervals of tables with these numbers of seeds are for."""
    several, one = any(n > 1 for n in n_seeds), any(n == 1 for n in n_seeds)
    if several and one:
        return f"{TARGET_OF_SEVERAL}; of a single seed, {TARGET_OF_ONE}"
    return TARGET_OF_SEVERAL if several else TARGET_OF_ONE


N_NODES = 40
"""Of the Gauss-Legendre rule: with 40, the quantile 0.975 is right to 5 digits below 2 degrees of
freedom, and to 10 from there on."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(N_NODES)

MAX_STEPS = 50  # of Newton's method, which converges in fewer than 10


@lru_cache(maxsize=4096)
def t_quantile(probability: float, df: float) -> float:
    """Returns the quantile of Student's t distribution; infinite `df` gives the normal one.

    With t = sqrt(df) tan(a), the density of a is C cos(a)^(df - 1), where C = Gamma((df + 1) / 2) /
    (sqrt(pi) Gamma(df / 2)) (Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964,
    26.7.1). Its integral from 0 is concave in a > 0, so that Newton's method, started below the
    root at the normal quantile, climbs to it without overshooting.
    """
    if not (0.5 <= probability < 1.0 and df >= 1.0):
        raise ValueError(
            f"quantile {probability} of {df} degrees of freedom, expected 0.5 <= quantile < 1 and "
            "at least one degree of freedom."
        )
    normal = NormalDist().inv_cdf(probability)
    if math.isinf(df):
        return normal
    log_scale = math.lgamma((df + 1.0) / 2.0) - math.lgamma(df / 2.0) - 0.5 * math.log(math.pi)
    scale, angle = math.exp(log_scale), math.atan(normal / math.sqrt(df))
    for _ in range(MAX_STEPS):
        places = 0.5 * angle * (_NODES + 1.0)
        area = 0.5 * angle * scale * float(_WEIGHTS @ np.cos(places) ** (df - 1.0))
        step = (probability - 0.5 - area) / (scale * math.cos(angle) ** (df - 1.0))
        angle += step
        if abs(step) <= 1e-13 * angle:
            break
    return math.sqrt(df) * math.tan(angle)
