"""Quantiles of Student's t distribution, for real degrees of freedom."""

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np

N_NODES = 40
"""Of the Gauss-Legendre rule: with 40, the quantile 0.975 is right to 5 digits below 2 degrees of
freedom, and to 10 from there on."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(N_NODES)

MAX_STEPS = 50
"""Of Newton's method, which converges in fewer than 10."""


@lru_cache(maxsize=4096)
def t_quantile(probability: float, df: float) -> float:
    """Returns the quantile of Student's t distribution.

    With t = sqrt(df) tan(a), the density of a is C cos(a)^(df - 1), where C = Gamma((df + 1) / 2) /
    (sqrt(pi) Gamma(df / 2)) (Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964,
    26.7.1). Its integral from 0 is concave in a > 0, so that Newton's method, started below the
    root at the normal quantile, climbs to it without overshooting.

    Args:
        probability: 0.5 or more, below 1.
        df: degrees of freedom, 1 or more; infinity gives the normal quantile.

    Raises:
        ValueError: an argument is out of its range.
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
