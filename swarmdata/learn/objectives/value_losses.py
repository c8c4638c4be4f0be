"""Losses of value decomposition over choices, online and offline, as pure functions.

Each column d of a robot's action has C choices with utilities U_dk. A recorded action a is a weight
w_dk(a) of each choice: 1 and 0 of recorded choices, the linear interpolation between the two
nearest bins of continuous actions.
"""

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.choices.behavior_heads import Head, cross_entropy


def robot_values(utilities: Tensor, weights: Tensor) -> Tensor:
    """Returns Q_i = 1/D sum_dk w_dk U_dk, [K, J, B, N] (Seyde et al. 2023, equation 2).

    Args:
        utilities: [K, J, B, N, D, C].
        weights: the actions as weights of the choices, [K, B, N, D, C].
    """
    return (utilities * weights[:, None]).sum(-1).mean(-1)


def huber_error(q: Tensor, y: Tensor) -> Tensor:
    """Returns sum_j Huber(Q_j - y), the mean over rows, [K].

    Args:
        q: values that J networks give, [K, J, B].
        y: targets, [K, B].
    """
    errors: Tensor = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none")
    return errors.mean(2).sum(1)


def conservative_gap(utilities: Tensor, weights: Tensor, exists: Tensor | None) -> Tensor:
    """Returns sum_j mean_id [log sum_k exp U_dk - sum_k w_dk U_dk], [K].

    Conservative Q-learning (Kumar et al. 2020, equation 4) robot by robot and column by column: the
    sum over joint actions has no such form and was found unstable.

    Args:
        utilities: [K, J, B, N, D, C].
        weights: the data's actions as weights of the choices, [K, B, N, D, C].
        exists: which choices there are, bool [N, D, C]; None: all.
    """
    taken = (utilities * weights[:, None]).sum(-1)  # [K, J, B, N, D]
    if exists is not None:
        utilities = utilities.masked_fill(~exists, -torch.inf)
    return (utilities.logsumexp(-1) - taken).mean((2, 3, 4)).sum(1)


def behavior_loss(log_probs: Tensor, weights: Tensor, head: Head) -> Tensor:
    """Returns -sum_d sum_k w_dk log pi_b(k | o_i)_d, the mean over robots and rows, [K].

    Args:
        log_probs: of the behavior head: `behavior_heads.behavior_log_probs`.
        weights: the data's actions as weights of the choices, [K, B, N, D, C].
        head: its kind.
    """
    return cross_entropy(log_probs, weights, head).mean((1, 2))
