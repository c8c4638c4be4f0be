"""Losses that extract a policy from a critic and a behavior density, as pure functions.

With each robot's value Q_i(b) of its action b, the density beta of the data's actions given o_i,
and an inverse temperature eta, the policy that is sought is the tilted density (Peng et al. 2019,
"Advantage-weighted regression", section 3):

    pi*(b | o_i) ~ beta(b | o_i) exp(eta Q_i(b))

The three losses reach it in different ways:

- `anchored`: max eta Q_i(pi) + log beta(pi | o_i) by the gradient of Q: it finds the mode of pi*.
  It is DDPG+BC in Park et al. 2024 ("Is value learning really the main bottleneck in offline RL?",
  arXiv 2406.09329) with a density in place of the squared error, and with a bounded gradient of Q,
  so that no action leaves the density's mean by more than eta times its variance times the bound.
- `weighted`: min exp(eta (Q_i(a_i) - V_i)) |pi - a_i|^2, V_i the mean of Q_i under beta (AWAC, Nair
  et al. 2020; CRR, Wang et al. 2020, its "exp").
- `tilted`: min |pi - sum_m w_m b_m|^2 with w = softmax_m eta Q_i(b_m) and b_m drawn from beta: the
  mean of pi* (samples weighted as in SfBC, Chen et al. 2023, and IDQL, Hansen-Estruch et al. 2023).

All are means over robots of terms of one robot: neither the pull of Q nor that of the data fades as
a team grows.
"""

import torch
from torch import Tensor

from swarmdata.learn.objectives.in_sample import exponential_weights


def anchored_loss(
    pi: Tensor, values: Tensor, mean: Tensor, deviation: Tensor, eta: Tensor, steepest: Tensor
) -> Tensor:
    """Returns -(Q_i(pi) + log beta(pi | o_i) / eta), the mean over robots, [K].

    Its gradient is what counts: constants are left out, and Q_i is the plane through 0 with the
    slope that Q_i has at pi, or with `steepest` where that is less.

    Args:
        pi: the policies' actions, [K, B, N, A].
        values: Q_i of them, with their gradient, [K, B, N].
        mean: of beta, [K, B, N, A].
        deviation: of beta, [K, B, N, A].
        eta: inverse temperature, [K].
        steepest: largest length of the gradient of Q with respect to one robot's action, [K].
    """
    held = 0.5 * ((pi - mean) / deviation).square().sum(3)  # [K, B, N]
    climbed = (bounded_gradient(values, pi, steepest) * pi).sum(3)  # [K, B, N]
    return (held / eta[:, None, None] - climbed).mean((1, 2))


def bounded_gradient(values: Tensor, pi: Tensor, steepest: Tensor) -> Tensor:
    """Returns the gradient of the sum of values with respect to each robot's action, [K, B, N, A].

    Args:
        values: with their gradient, [K, B, N].
        pi: actions that they depend on, [K, B, N, A].
        steepest: length to which longer gradients are cut, [K].
    """
    (gradient,) = torch.autograd.grad(values.sum(), pi)
    length = gradient.norm(dim=3, keepdim=True)  # [K, B, N, 1]
    return gradient * (steepest[:, None, None, None] / length).clamp(max=1.0)


def weighted_loss(
    pi: Tensor, actions: Tensor, advantages: Tensor, eta: Tensor, largest: float
) -> Tensor:
    """Returns the squared error to the data's actions, weighted by exp(eta advantage), [K].

    Args:
        pi: the policies' actions, [K, B, N, A].
        actions: of the data, [K, B, N, A].
        advantages: Q_i(a_i) - V_i, [K, B, N].
        eta: inverse temperature, [K].
        largest: weight.
    """
    weights = exponential_weights(eta[:, None, None] * advantages, largest)
    return (weights * (pi - actions).square().sum(3)).mean((1, 2)) / weights.mean((1, 2))


def tilted_mean(candidates: Tensor, values: Tensor, eta: Tensor) -> Tensor:
    """Returns sum_m w_m b_m, the mean of the tilted density, [K, B, N, A].

    Args:
        candidates: b_m, drawn from beta, [K, B, N, M, A].
        values: Q_i of them, [K, B, N, M].
        eta: inverse temperature, [K].
    """
    weights = (eta[:, None, None, None] * values).softmax(3)
    return (weights[..., None] * candidates).sum(3)


def tilted_loss(pi: Tensor, candidates: Tensor, values: Tensor, eta: Tensor) -> Tensor:
    """Returns the squared error to the tilted mean, a constant, [K]; arguments as above."""
    target = tilted_mean(candidates, values, eta).detach()
    return (pi - target).square().sum(3).mean((1, 2))
