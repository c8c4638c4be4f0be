"""Which episodes of a dataset a catalogue shows: all, or a sample of every policy and outcome."""

import numpy as np

from swarmdata.store import EpisodeTable
from swarmdata.types import Int


def choose_episodes(table: EpisodeTable, most: int | None) -> Int:
    """Returns the episodes to show, at most `most` unless it is None, in stored order.

    Each policy and end reason has its share of the sample, by largest remainders, and at least one
    episode while there is room. Within them, episodes are evenly spaced in stored order.
    """
    if most is None or len(table) <= most:
        return np.arange(len(table))
    kinds = table.policy.astype(np.int64) * 256 + table.end_reason
    _, kind, counts = np.unique(kinds, return_inverse=True, return_counts=True)
    chosen = []
    for k, n in enumerate(_shares(counts, most).tolist()):
        rows = np.flatnonzero(kind == k)
        chosen.append(rows[np.arange(n) * len(rows) // max(n, 1)])
    return np.sort(np.concatenate(chosen))


def _shares(counts: Int, most: int) -> Int:
    """Splits `most` over groups in proportion to their sizes, with at least one for each."""
    exact = most * counts / counts.sum()
    shares = np.maximum(np.floor(exact).astype(np.int64), 1)
    while shares.sum() < most:
        shares[np.argmax(exact - shares)] += 1
    while shares.sum() > most:  # of many small groups: the most over-represented first
        shares[np.argmax(np.where(shares > 0, shares - exact, -np.inf))] -= 1
    return shares
