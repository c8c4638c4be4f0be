"""Conservative penalties: critics learn to value the data's actions above actions nobody took.

CQL (Kumar et al. 2020, eq. 4, its form CQL(H)) adds to a critic's loss, at the data's (x, a),

    alpha E[ tau log integral exp(Q(x, b) / tau) db - Q(x, a) ]

The integral is estimated from sampled actions b_m with densities p_m, as in the paper's appendix F:

    log integral exp(Q / tau) ~ log 1/M sum_m exp(Q(x, b_m) / tau) / p_m

Each critic is penalized for its own estimate. A critic that is penalized for another's values has
no reason to lower its own (as the second critic of og-marl's torch `maddpg_cql`, commit f4eb8f0).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import normal_like, uniform_like
from swarmdata.learn.objectives.losses import critics_mean


class Samples(NamedTuple):
    """Sampled actions of N agents, and the log of the density each sample was drawn with."""

    actions: Tensor  # [K, B, M, N, A]
    log_density: Tensor  # [K, B, M]


def uniform_samples(
    generators: Sequence[torch.Generator], actions: Tensor, n_samples: int
) -> Samples:
    """Returns M = `n_samples` actions in each row, drawn evenly from [-1, 1].

    They are shaped as `actions`, [K, B, N, A]; there is one generator for each seed.
    """
    template = repeated(actions, n_samples)
    drawn = 2 * uniform_like(generators, template) - 1
    density = uniform_log_density(math.prod(actions.shape[2:]))
    return Samples(drawn, torch.full_like(drawn[..., 0, 0], density))


def uniform_log_density(width: int) -> float:
    """Returns log p of `width` numbers drawn evenly from [-1, 1]."""
    return -width * math.log(2.0)


def noisy_samples(
    generators: Sequence[torch.Generator], actions: Tensor, n_samples: int, deviation: float
) -> Samples:
    """Returns M = `n_samples` actions in each row near given ones, [K, B, N, A].

    `deviation` is that of the Gaussian noise in each component; the density is that of the noise
    before it is clipped. There is one generator for each seed.
    """
    centers = repeated(actions, n_samples)
    noise = normal_like(generators, centers)
    log_density = -0.5 * noise.square() - math.log(deviation * math.sqrt(2 * math.pi))
    return Samples((centers + deviation * noise).clamp(-1, 1), log_density.sum((3, 4)))


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Returns several draws of the same rows as one."""
    actions, densities = zip(*parts, strict=True)
    return Samples(torch.cat(actions, 2), torch.cat(densities, 2))


def soft_maximum(values: Tensor, log_density: Tensor, temperature: float) -> Tensor:
    """Returns tau log 1/M sum_m exp(Q_m / tau) / p_m of each critic's own values, [K, J, B].

    Values of sampled actions are [K, J, B, M], the log of their density [K, B, M]. A small
    temperature gives nearly the largest value, a large one the mean and a constant.
    """
    weighted = values / temperature - log_density[:, None]
    return temperature * (weighted.logsumexp(-1) - math.log(values.shape[-1]))


def cql_gap(
    log_density: Tensor, values: Tensor, q: Tensor, temperature: float, limit: float,
    alive: Tensor | None = None,
) -> Tensor:  # fmt: skip
    """Returns gap_j, the penalty of each critic, as a mean over rows, [K, J].

    It is linear in Q, so that nothing else ends it: where all data are alike, values of other
    actions fall without end, and those of the data are dragged along (see `omar`). A row is not
    penalized further once the data's action is worth `limit` more than the soft maximum, as the
    threshold of CQL's Lagrange multiplier does for the mean of rows (Kumar et al. 2020, eq. 30).

    Sampled actions have log densities [K, B, M] and values [K, J, B, M], the data's actions q, [K,
    J, B]; the temperature is tau of the soft maximum; `alive` is as in `losses.critics_mean`.
    """
    gaps = soft_maximum(values, log_density, temperature) - q
    return critics_mean(gaps.clamp(min=-limit), alive)


def repeated(actions: Tensor, n_samples: int) -> Tensor:
    """Returns actions [K, B, N, A] M times in each row, [K, B, M, N, A]."""
    return actions[:, :, None].expand(-1, -1, n_samples, -1, -1)
