"""Rewards from their terms: the one function that worlds and readers of datasets share.

The reward of agent i in a step, with the float32 values x_ir of its terms, their signed weights w_r
and the share s of the team, all computed in float64:

    own_i    = ((w_0 x_i0 + w_1 x_i1) + w_2 x_i2) + ...      in the order of the terms, from 0
    mean     = ((own_0 + own_1) + own_2 + ...) / N           in the order of the agents
    reward_i = (1 - s) own_i + s mean                        rounded to float32

In a task of several sides, the mean is that of the agent's own side. The order is part of the
definition: a plain loop in any language gives the same bits.
"""

from collections.abc import Sequence

import numpy as np

from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Float, Int


@kernel
def weigh_terms(
    terms: Float,  # [N, R]
    weights: Double,  # [R] of the terms, with their signs
    team_share: float,  # [0, 1] part of each reward that is the mean over the side, in
    bounds: Int,  # of the sides (`TaskSpec.side_bounds`), one longer than there are sides
    own: Double,  # [N] scratch
    rewards: Float,  # [N] written
) -> None:
    """Writes the rewards of one step."""
    for side in range(bounds.shape[0] - 1):
        first, end, mean = bounds[side], bounds[side + 1], 0.0
        for i in range(first, end):
            total = 0.0
            for r in range(terms.shape[1]):
                total += weights[r] * float(terms[i, r])
            own[i] = total
            mean += total
        mean /= end - first
        for i in range(first, end):
            rewards[i] = (1.0 - team_share) * own[i] + team_share * mean


@kernel
def _weigh_steps(
    terms: Float, weights: Double, team_share: float, bounds: Int, own: Double, rewards: Float
) -> None:
    for t in range(terms.shape[0]):
        weigh_terms(terms[t], weights, team_share, bounds, own, rewards[t])


def weighted_rewards(
    terms: Float, weights: Double, team_share: float, bounds: Sequence[int]
) -> Float:
    """Returns the rewards that steps have under some weights, float32 [T, N].

    Args:
        terms: unweighted terms of the rewards, [T, N, R].
        weights: of the terms, with their signs, [R].
        team_share: part of each reward that is the mean over the side, in [0, 1].
        bounds: of the sides, `TaskSpec.side_bounds`.
    """
    steps, n, _ = terms.shape
    rewards = np.empty((steps, n), dtype=np.float32)
    sides = np.array(bounds, dtype=np.int64)
    _weigh_steps(np.ascontiguousarray(terms), weights, team_share, sides, np.empty(n), rewards)
    return rewards
