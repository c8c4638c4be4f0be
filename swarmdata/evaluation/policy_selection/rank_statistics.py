"""How well a criterion that needs no simulator ranks policies: rank correlation and regret.

After Fu et al., "Benchmarks for Deep Off-Policy Evaluation", ICLR 2021, section 4.
"""

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_statistics import Estimate, bootstrap
from swarmdata.types import Double


def ranks(values: Double) -> Double:
    """Returns ranks from 1 for the smallest; ties get their mean rank; [..., n] -> [..., n]."""
    smaller = (values[..., :, None] > values[..., None, :]).sum(axis=-1)
    equal = (values[..., :, None] == values[..., None, :]).sum(axis=-1)
    return np.asarray(smaller + (equal + 1) / 2.0)


def spearman(estimates: Double, scores: Double) -> Double:
    """Spearman's rank correlation, Pearson's of the ranks; [..., n], [..., n] -> [...].

    It is 0 if one side is constant: a criterion that does not distinguish policies ranks none.
    """
    a, b = (ranks(side) for side in (estimates, scores))
    a, b = (side - side.mean(axis=-1, keepdims=True) for side in (a, b))
    scale = np.sqrt(np.square(a).sum(axis=-1) * np.square(b).sum(axis=-1))
    product = (a * b).sum(axis=-1)
    # ranks are halves, so that a constant side is exactly 0 after centering
    return np.asarray(np.divide(product, scale, out=np.zeros_like(scale), where=scale > 0))


def regret(estimates: Double, scores: Double, k: int = 1) -> float:
    """Returns how much worse the best of k <= n chosen policies is than the best of all, [n] each.

    Regret@k = max_i V_i - max_{j in top-k} V_j (Fu et al. 2021, section 4), with top-k by estimate.
    Among equal estimates the worst policies are chosen, which gives the largest regret of all
    orders of ties.
    """
    chosen = np.lexsort((scores, -estimates))[:k]
    return float(scores.max() - scores[chosen].max())


def rank_correlation(estimates: Double, scores: Double) -> Estimate:
    """Spearman's correlation of a criterion, higher is better, with scores of policies, [n] each.

    The interval is a percentile bootstrap over policies: pairs of estimate and score are drawn with
    replacement. Policies of one run share data and settings, so it tends to be too narrow.

    Raises:
        SchemaError: they are not finite, of two lengths, or of fewer than two policies.
    """
    shapes = [list(side.shape) for side in (estimates, scores)]
    finite = all(np.isfinite(side).all() for side in (estimates, scores))
    if shapes[0] != shapes[1] or estimates.ndim != 1 or len(estimates) < 2 or not finite:
        raise SchemaError(
            f"estimates are {shapes[0]} and scores {shapes[1]}, {'all' if finite else 'not all'} "
            "finite; expected two finite vectors of one length, at least 2: one number per policy."
        )

    def correlation(rows: Double) -> Double:
        index = rows[..., 0].astype(np.int64)
        return spearman(estimates[index], scores[index])

    rows = np.arange(len(scores), dtype=np.float64)[:, None]
    return bootstrap(correlation, rows, generator=np.random.default_rng(0))


def pessimistic_value(values: Double) -> float:
    """Returns the lower end of the 95 % bootstrap interval of the least fit's mean, of [M, E].

    A policy that left the data is overrated by some of the M fits and not by others, so the least
    of them is trusted (as in the targets of Fujimoto et al. 2018, eq. 10), and no more than what
    its E initial states support.
    """

    def least_mean(tables: Double) -> Double:
        return np.asarray(tables.mean(axis=-2).min(axis=-1))

    return bootstrap(least_mean, values.T, generator=np.random.default_rng(0)).low
