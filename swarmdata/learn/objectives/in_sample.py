"""Losses of methods that never value an action that the data lack: expectiles, weighted cloning.

`expectile_loss` and `exponential_weights` are of implicit Q-learning (Kostrikov et al. 2022),
`soft_value_loss` is OMIGA's (Wang et al. 2023).
"""

import math

import torch
from torch import Tensor


def expectile_loss(errors: Tensor, expectile: float) -> Tensor:
    """Returns |tau - 1(u < 0)| u^2 of each error u (Kostrikov et al. 2022, eq. 5).

    What minimizes its mean over u = q - v is the tau-expectile of q: its mean for tau 1/2, and for
    tau to 1 its maximum.

    Args:
        errors: u, of any shape.
        expectile: tau, 0 to 1.
    """
    return torch.where(errors < 0, 1 - expectile, expectile) * errors.square()


def exponential_weights(exponents: Tensor, largest: float) -> Tensor:
    """Returns min(exp(z), largest), without a gradient, of exponents z of any shape."""
    return exponents.detach().clamp(max=math.log(largest)).exp()


def cloning_loss(pi: Tensor, actions: Tensor) -> Tensor:
    """Returns 1/N sum_i 1/A |pi(o_i, i) - a_i|^2, the mean over rows, [K].

    Args:
        pi: actions of the policies, [K, B, N, A].
        actions: of the data, [K, B, N, A].
    """
    return (pi - actions).square().mean((1, 2, 3))


def weighted_cloning_loss(pi: Tensor, actions: Tensor, weights: Tensor) -> Tensor:
    """Returns the weighted squared error of the policies' actions, [K].

    It is minus the log-likelihood of a Gaussian of fixed deviation around the policy's action, but
    for a factor that Adam does not see and a constant.

    Args:
        pi: actions of the policies, [K, B, N, A].
        actions: of the data, [K, B, N, A].
        weights: of the agents' actions, [K, B, N], or [K, B, 1] of all at once.
    """
    return (weights * (pi - actions).square().mean(3)).mean((1, 2))


def soft_value_loss(exponents: Tensor, values: Tensor, largest: float) -> Tensor:
    """Returns exp(z) + v elementwise, with the exponential's tangent beyond z = log(largest).

    With z = (q - v), its mean over q is least where the mean of exp(q - v) is 1, so v is the
    log-mean-exp of q: between the mean and the maximum.

    A z that is cut instead (as in OMIGA's code, at 10) has no gradient where v is far too low, and
    what is left, + v, lowers it further.

    Args:
        exponents: z, which must carry the gradient of v, of any shape.
        values: v, of the same shape.
        largest: of exp(z) before it becomes a line, above 0.
    """
    limit = math.log(largest)
    below = exponents.clamp(max=limit)
    return below.exp() + largest * (exponents - below) + values
