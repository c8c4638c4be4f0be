"""Losses of critics and actors that algorithms share, as pure functions.

Those of value decomposition are over choices: column d of a robot's action has C of them with
utilities U_dk, and a recorded action a is a weight w_dk(a) of each (`Choices.weights`).

Some extract a policy from a critic and a behavior density. With each robot's value Q_i(b)
of its action b, the density beta of the data's actions given o_i, and an inverse temperature eta,
the policy that is sought is the tilted density (Peng et al. 2019, "Advantage-weighted regression",
section 3):

    pi*(b | o_i) ~ beta(b | o_i) exp(eta Q_i(b))

- `anchored`: max eta Q_i(pi) + log beta(pi | o_i) by the gradient of Q: it finds the mode of pi*.
  It is DDPG+BC in Park et al. 2024 ("Is value learning really the main bottleneck in offline RL?",
  arXiv 2406.09329) with a density in place of the squared error, and with a bounded gradient of Q.
- `weighted`: min |pi - a_i|^2 over rows drawn in proportion to exp(eta (Q_i(a_i) - V_i)), V_i the
  mean of Q_i under beta (AWAC, Nair et al. 2020; CRR, Wang et al. 2020, its "exp", have these
  weights as factors). eta is less where few rows would count: `objectives.weighted_rows`.
- `tilted`: min |pi - sum_m w_m b_m|^2 with w = softmax_m eta Q_i(b_m) and b_m drawn from beta: the
  mean of pi* (samples weighted as in SfBC, Chen et al. 2023, and IDQL, Hansen-Estruch et al. 2023).

All are means over robots of terms of one robot.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.choices.behavior_heads import Head, cross_entropy
from swarmdata.learn.networks.presence import agent_mean


class Loss(NamedTuple):
    """A loss of K seeds, and the quantities to report beside it."""

    total: Tensor  # [K], what is minimized
    reported: dict[str, Tensor]  # each [K]


def team_reward(rewards: Tensor) -> Tensor:
    """Returns team rewards, [...]: the mean over agents of rewards [..., N]."""
    return rewards.mean(-1)


def td_target(
    rewards: Tensor, terminations: Tensor, next_values: Tensor, discount: float
) -> Tensor:
    """Returns r + discount * (1 - termination) * V(s'), [...], of team rewards [...].

    Terminations, bool, and `next_values` are [...] too; the discount of a step is 0 to 1.

    A truncation does not stop the bootstrap: the horizon cut the episode, the task went on. It
    needs `next_values` of the state that was reached, never of the next episode's first state
    (Pardo et al. 2018, "Time limits in reinforcement learning", section 3).
    """
    return rewards + discount * (~terminations) * next_values


def critics_mean(errors: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns the mean over rows, [K, J], of what J critics have, [K, J, R].

    Rows of robots that have left, which `alive`, bool [K, ...] of R rows, says, do not count.
    """
    if alive is None:
        return errors.mean(2)
    return torch.stack([agent_mean(each, alive.flatten(1)) for each in errors.unbind(1)], 1)


def td_error(q: Tensor, y: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns sum_j (Q_j - y)^2, the mean over rows, [K], of values [K, J, R] and y [K, R].

    `alive` is as in `critics_mean`.
    """
    return critics_mean((q - y[:, None]).square(), alive).sum(1)


def value_size(q: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns max(mean |Q|, 1), a constant, [K], of values [K, ...] in scaled rewards.

    `alive`, of the same shape, leaves rows of robots out that have left.

    It divides values in an actor's loss (Fujimoto & Gu 2021, eq. 5). 1 is one standard deviation of
    the returns-to-go: returns cross 0, where the paper's quotient explodes.
    """
    size = q.detach().abs()
    return (size.flatten(1).mean(1) if alive is None else agent_mean(size, alive)).clamp(min=1.0)


def expectile_loss(errors: Tensor, expectile: float) -> Tensor:
    """Returns |tau - 1(u < 0)| u^2 of each error u (Kostrikov et al. 2022, eq. 5), tau in [0, 1].

    What minimizes its mean over u = q - v is the tau-expectile of q: its mean for tau 1/2, and for
    tau to 1 its maximum.
    """
    return torch.where(errors < 0, 1 - expectile, expectile) * errors.square()


LARGEST_ADVANTAGE = 2.0
"""In deviations of the advantages of a batch."""


def standard_advantages(advantages: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns advantages less their mean, over their deviation, clipped, without a gradient.

    With exponents beta times these, weights depend on no unit of rewards, and no row has all of
    them. Mean and deviation are over rows and robots of each seed, [K, R, N], that are `alive`.
    """
    centered = advantages.detach() - _mean_of_seeds(advantages.detach(), alive)
    deviation = _mean_of_seeds(centered.square(), alive).sqrt() + 1e-6
    return (centered / deviation).clamp(-LARGEST_ADVANTAGE, LARGEST_ADVANTAGE)


def _mean_of_seeds(values: Tensor, alive: Tensor | None) -> Tensor:
    """The mean over rows and robots, [K, 1, 1], of values [K, R, N]."""
    if alive is None:
        return values.mean((1, 2), keepdim=True)
    return agent_mean(values, alive)[:, None, None]


def batch_weights(exponents: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns exp(z) / Z of exponents z, [K, R, N], Z the mean over rows and robots of a seed.

    Robots that have left, which `alive` says, have weight 0 and no part in the mean.
    """
    if alive is None:
        return exponents.flatten(1).softmax(1).view(exponents.shape) * exponents[0].numel()
    rest = exponents.masked_fill(~alive, -torch.inf)
    return rest.flatten(1).softmax(1).view(rest.shape) * alive.sum((1, 2), keepdim=True)


def cloning_loss(pi: Tensor, actions: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns 1/N sum_i 1/A |pi(o_i, i) - a_i|^2, the mean over rows, [K].

    Actions, pi and the data's, are [K, B, N, A]; `alive` is as in `presence`. It is minus the
    log-likelihood of a Gaussian of fixed deviation, but for a factor and a constant.
    """
    return agent_mean((pi - actions).square(), alive)


def soft_value_loss(exponents: Tensor, values: Tensor, largest: float) -> Tensor:
    """Returns exp(z) + v elementwise, with the exponential's tangent beyond exp(z) = `largest`.

    With z = (q - v), which must carry the gradient of v, its mean over q is least where the mean of
    exp(q - v) is 1, so v is the log-mean-exp of q (OMIGA, Wang et al. 2023). A z that is cut
    instead, as in OMIGA's code, has no gradient where v is far too low, and + v lowers it further.
    """
    limit = math.log(largest)
    below = exponents.clamp(max=limit)
    return below.exp() + largest * (exponents - below) + values


def anchored_loss(
    pi: Tensor, values: Tensor, mean: Tensor, deviation: Tensor, eta: Tensor, steepest: Tensor
) -> Tensor:
    """Returns -(Q_i(pi) + log beta(pi | o_i) / eta), the mean over robots, [K].

    Its gradient is what counts: constants are left out, and Q_i is the plane through 0 with the
    slope that Q_i has at pi, or with `steepest`, [K], where that is less. The policies' actions,
    mean and deviation of beta are [K, B, N, A]; values Q_i(pi), with their gradient, [K, B, N]; eta
    is the inverse temperature, [K].
    """
    held = 0.5 * ((pi - mean) / deviation).square().sum(3)  # [K, B, N]
    climbed = (bounded_gradient(values, pi, steepest) * pi).sum(3)  # [K, B, N]
    return (held / eta[:, None, None] - climbed).mean((1, 2))


def bounded_gradient(values: Tensor, pi: Tensor, steepest: Tensor) -> Tensor:
    """Returns the gradient of the sum of values with respect to each robot's action, [K, B, N, A].

    Values [K, B, N] depend on pi, [K, B, N, A]; gradients longer than `steepest`, [K], are cut.
    """
    (gradient,) = torch.autograd.grad(values.sum(), pi)
    length = gradient.norm(dim=3, keepdim=True)  # [K, B, N, 1]
    return gradient * (steepest[:, None, None, None] / length).clamp(max=1.0)


def tilted_loss(pi: Tensor, candidates: Tensor, values: Tensor, eta: Tensor) -> Tensor:
    """Returns the squared error to sum_m w_m b_m, the mean of the tilted density, [K].

    Candidates b_m, [K, B, N, M, A], are drawn from beta; their values are [K, B, N, M], eta [K].
    """
    weights = (eta[:, None, None, None] * values).softmax(3)
    target = (weights[..., None] * candidates).sum(3).detach()
    return (pi - target).square().sum(3).mean((1, 2))


def robot_values(utilities: Tensor, weights: Tensor) -> Tensor:
    """Returns Q_i = 1/D sum_dk w_dk U_dk, [K, J, B, N] (Seyde et al. 2023, equation 2).

    Utilities are [K, J, B, N, D, C], weights of the choices [K, B, N, D, C].
    """
    return (utilities * weights[:, None]).sum(-1).mean(-1)


def huber_error(q: Tensor, y: Tensor, alive: Tensor | None = None) -> Tensor:
    """Returns sum_j Huber(Q_j - y), the mean over rows, [K], of values [K, J, R] and y [K, R].

    `alive` is as in `critics_mean`.
    """
    errors: Tensor = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none")
    return critics_mean(errors, alive).sum(1)


def conservative_gap(
    utilities: Tensor, weights: Tensor, exists: Tensor | None, alive: Tensor | None
) -> Tensor:
    """Returns sum_j mean_id [log sum_k exp U_dk - sum_k w_dk U_dk], [K].

    Conservative Q-learning (Kumar et al. 2020, equation 4) robot by robot and column by column: the
    sum over joint actions has no such form and was found unstable. Utilities are [K, J, B, N, D,
    C], the data's actions as weights of the choices [K, B, N, D, C]; choices that there are
    (`exists`) bool [N, D, C], None: all; robots that count (`alive`) [K, B, N].
    """
    taken = (utilities * weights[:, None]).sum(-1)  # [K, J, B, N, D]
    if exists is not None:
        utilities = utilities.masked_fill(~exists, -torch.inf)
    gaps = utilities.logsumexp(-1) - taken
    if alive is None:
        return gaps.mean((2, 3, 4)).sum(1)
    return torch.stack([agent_mean(each, alive) for each in gaps.unbind(1)]).sum(0)


def behavior_loss(log_probs: Tensor, weights: Tensor, head: Head, alive: Tensor | None) -> Tensor:
    """Returns -sum_d sum_k w_dk log pi_b(k | o_i)_d, the mean over robots and rows, [K].

    `log_probs` are those of `behavior_heads.behavior_log_probs`, for that kind of head; weights of
    the choices, the data's actions, [K, B, N, D, C]; `alive` is as in `presence`.
    """
    return agent_mean(cross_entropy(log_probs, weights, head), alive)
