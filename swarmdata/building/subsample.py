"""Which episodes a smaller dataset takes: in proportion, or so that returns are distributed alike.

Each episode has a key of its seed, so that a smaller choice is part of a larger one.
"""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import BuildError, SchemaError
from swarmdata.numerics.random import derive
from swarmdata.store import EpisodeTable
from swarmdata.types import Double, Int, Seeds

N_RETURN_BINS = 20  # bins of returns, each with as many episodes of the dataset that is matched


def sized(table: EpisodeTable, n_steps: int, seed: int) -> Int:
    """Chooses episodes of at least `n_steps` joint steps, as few as their order allows; increasing.

    Splits and policies keep their shares of the steps, each to within an episode: proportional
    stratified sampling (Cochran, "Sampling Techniques", 3rd edition, 1977, section 5.5).

    Raises:
        SchemaError: there are not so many steps.
    """
    strata = table.policy.astype(np.int64) * 256 + table.split
    order = proportional(table.lengths, strata, derive(seed, table.seeds))
    return _prefix(table.lengths, order, n_steps)


def _prefix(lengths: Int, order: Int, n_steps: int) -> Int:
    ends = np.cumsum(lengths[order])
    if n_steps < 1 or not len(ends) or ends[-1] < n_steps:
        there = int(ends[-1]) if len(ends) else 0
        raise SchemaError(
            f"n_steps is {n_steps:,}, expected 1 to {there:,}, the joint steps to choose from"
        )
    return np.sort(order[: int(np.searchsorted(ends, n_steps)) + 1])


def proportional(lengths: Int, strata: Int, keys: Seeds) -> Int:
    """An order of episodes of which every prefix holds each stratum's steps in proportion.

    Inside a stratum the order is that of the random keys. An episode's place is the share of its
    stratum's steps that are before its middle; places are merged. All arguments are [n].
    """
    places = np.empty(len(lengths))
    for stratum in np.unique(strata):
        mine = np.flatnonzero(strata == stratum)
        mine = mine[np.argsort(keys[mine], kind="stable")]
        ends = np.cumsum(lengths[mine])
        places[mine] = (ends - 0.5 * lengths[mine]) / ends[-1]
    order: Int = np.lexsort((keys, places))
    return order


def matched(table: EpisodeTable, target: Double, n_steps: int | None, bins: int, seed: int) -> Int:
    """Chooses as many episodes as there can be whose returns are distributed as those of another.

    Histogram matching, as OG-MARL's `subsample_similar` (Formanek et al., "Putting Data at the
    Centre of Offline Multi-Agent RL", arXiv 2409.12001), with bins at the quantiles of the other:
    bin k gets the largest whole number of episodes that is at most m t_k, where t_k are the other's
    episodes in it, and m is as large as the scarcest bin allows.

    Args:
        table: the episodes to choose from.
        target: team returns of the other dataset, [n].
        n_steps: least joint steps, None for all that match.
        bins: number of bins, at most; repeated returns make fewer.
        seed: of the choice inside bins.

    Returns:
        indices into the table, increasing.

    Raises:
        SchemaError: fewer than one bin, or not so many steps.
        BuildError: a bin has no episodes to choose from.
    """
    if bins < 1 or not len(target):
        raise SchemaError(f"bins is {bins} for {len(target)} returns, expected 1 or more of both")
    edges = quantile_edges(target, bins)
    mine, theirs = bin_of(table.team_return, edges), bin_of(target, edges)
    n_bins = max(1, len(edges) - 1)
    counts, wanted = (np.bincount(b[b >= 0], minlength=n_bins).tolist() for b in (mine, theirs))
    for k in np.flatnonzero(np.array(counts) == 0).tolist():
        raise BuildError(
            f"no episode has a return from {edges[k]:g} to {edges[min(k + 1, len(edges) - 1)]:g}, "
            f"but {wanted[k] / len(target):.1%} of those to be matched do. Use fewer bins, or a "
            "source with such episodes."
        )
    scarce = min(range(n_bins), key=lambda k: Fraction(counts[k], wanted[k]))
    keys = derive(seed, table.seeds)
    taken = []
    for k in range(n_bins):
        pool = np.flatnonzero(mine == k)
        quota = wanted[k] * counts[scarce] // wanted[scarce]
        taken.append(pool[np.argsort(keys[pool], kind="stable")][:quota])
    chosen = np.sort(np.concatenate(taken))
    if n_steps is None:
        return chosen
    order = proportional(table.lengths[chosen], mine[chosen], keys[chosen])
    return chosen[_prefix(table.lengths[chosen], order, n_steps)]


def quantile_edges(values: Double, bins: int) -> Double:
    """Edges of bins that hold the same number of the values, which are edges themselves."""
    ranks = (np.arange(bins + 1) * (len(values) - 1)) // bins
    return np.unique(np.sort(values)[ranks])


def bin_of(values: Double, edges: Double) -> Int:
    """Bin of each value: k is above edge k, up to edge k + 1; 0 has both its edges; -1 is none."""
    found = np.searchsorted(edges[1:] if len(edges) > 1 else edges, values, side="left")
    outside: NDArray[np.bool_] = (values < edges[0]) | (values > edges[-1])
    return np.where(outside, -1, found)
