"""Counts the deadlocks of an episode: groups of robots that begin to block each other."""

import math

import numpy as np

from swarmdata.types import Bool, Double

STILL_TIME = 3.0  # s
STILL_DISTANCE = 0.05  # m
NEAR_GAP = 0.3  # m, between surfaces

DEADLOCK_MEANING = (
    f"A robot stands still in a state if it is less than {STILL_DISTANCE:g} m from where it was "
    f"{STILL_TIME:g} s earlier. Two robots that stand still with at most {NEAR_GAP:g} m between "
    "their surfaces are locked. Robots that are locked, one with the next, are a group. A deadlock "
    "begins in a state with a group in which no robot was locked in the state before"
)
"""What `count_deadlocks` counts, for cards."""


def locked_pairs(positions: Double, radii: Double, control_dt: float) -> Bool:
    """Which pairs of robots are locked in each step, [T+1, N, N].

    `positions`: m, [T+1, N, 2]. `radii`: m, [N]. `control_dt`: s.
    """
    n_still = max(math.ceil(STILL_TIME / control_dt - 1e-9), 1)
    still = np.zeros(positions.shape[:2], dtype=np.bool_)
    moved = positions[n_still:] - positions[:-n_still]
    still[n_still:] = (moved * moved).sum(-1) < STILL_DISTANCE**2
    locked: Bool = still[:, :, None] & still[:, None]
    locked &= ~np.eye(len(radii), dtype=np.bool_)
    some = locked.any((1, 2))  # distances are needed in few steps
    apart = np.sqrt(np.square(positions[some][:, :, None] - positions[some][:, None]).sum(-1))
    locked[some] &= apart - radii - radii[:, None] <= NEAR_GAP
    return locked


def count_deadlocks(positions: Double, radii: Double, control_dt: float) -> int:
    """Counts the deadlocks that begin in an episode; arguments as in `locked_pairs`."""
    locked = locked_pairs(positions, radii, control_dt)
    held: Bool = np.asarray(locked.any(-1))  # [T+1, N]
    count = 0
    for t in np.flatnonzero(held.any(-1)).tolist():
        if (held[t] & ~held[t - 1]).any():  # held[0] is never true: no robot has stood long enough
            count += sum(not held[t - 1, group].any() for group in _groups(locked[t]))
    return count


def _groups(pairs: Bool) -> Bool:
    """The connected groups of the symmetric relation `pairs`, as rows of who is in them, [G, N]."""
    reach = pairs | np.eye(len(pairs), dtype=np.bool_)
    for _ in range(len(pairs).bit_length()):
        reach = reach @ reach
    return np.unique(reach[pairs.any(1)], axis=0)
