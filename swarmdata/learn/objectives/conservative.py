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
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from swarmdata.learn.networks.critics import JointCritics
from swarmdata.learn.training.exploration import normal_like, uniform_like


class Samples(NamedTuple):
    """Sampled actions of N agents, and the log of the density each sample was drawn with."""

    actions: Tensor  # [K, B, M, N, A]
    log_density: Tensor  # [K, B, M]


def uniform_samples(
    generators: Sequence[torch.Generator], actions: Tensor, n_samples: int
) -> Samples:
    """Returns actions drawn evenly from [-1, 1].

    Args:
        generators: one per seed, [K].
        actions: of the right shape, [K, B, N, A].
        n_samples: for each row, M.
    """
    template = _repeated(actions, n_samples)
    drawn = 2 * uniform_like(generators, template) - 1
    width = math.prod(actions.shape[2:])
    return Samples(drawn, torch.full_like(drawn[..., 0, 0], -width * math.log(2.0)))


def noisy_samples(
    generators: Sequence[torch.Generator], actions: Tensor, n_samples: int, deviation: float
) -> Samples:
    """Returns actions near given ones; the density is that of the noise before it is clipped.

    Args:
        generators: one per seed, [K].
        actions: where to sample, [K, B, N, A].
        n_samples: for each row, M.
        deviation: of the Gaussian noise in each component.
    """
    centers = _repeated(actions, n_samples)
    noise = normal_like(generators, centers)
    log_density = -0.5 * noise.square() - math.log(deviation * math.sqrt(2 * math.pi))
    return Samples((centers + deviation * noise).clamp(-1, 1), log_density.sum((3, 4)))


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Returns several draws of the same rows as one."""
    actions, densities = zip(*parts, strict=True)
    return Samples(torch.cat(actions, 2), torch.cat(densities, 2))


def draw_agents(generators: Sequence[torch.Generator], actions: Tensor) -> Tensor:
    """Returns one agent for each row, drawn evenly, as a mask, bool [K, B, N].

    Args:
        generators: one per seed, [K].
        actions: [K, B, N, A].
    """
    n_agents = actions.shape[2]
    number = (uniform_like(generators, actions[:, :, 0, 0]) * n_agents).long()
    # the product rounds up to N in rare cases
    number = number.clamp(max=n_agents - 1)
    return number[..., None] == torch.arange(n_agents, device=actions.device)


def replace_drawn(actions: Tensor, others: Tensor, agents: Tensor) -> Tensor:
    """Returns `actions` with those of the drawn agents taken from `others`; broadcasts.

    Args:
        actions: joint actions, [..., N, A].
        others: actions for the drawn agents, [..., N, A] or [..., 1, A].
        agents: mask of the drawn agents, bool [..., N].
    """
    return torch.where(agents[..., None], others, actions)


def counterfactual_samples(
    generators: Sequence[torch.Generator], actions: Tensor, agents: Tensor, n_samples: int
) -> Samples:
    """Returns joint actions of the data but for one agent in each row, who acts evenly at random.

    Args:
        generators: one per seed, [K].
        actions: of the data, [K, B, N, A].
        agents: who leaves the data, bool [K, B, N], one in each row.
        n_samples: for each row, M.
    """
    drawn = uniform_samples(generators, actions[:, :, :1], n_samples)  # [K, B, M, 1, A]
    joint = replace_drawn(actions[:, :, None], drawn.actions, agents[:, :, None])
    return Samples(joint, drawn.log_density)


def soft_maximum(values: Tensor, log_density: Tensor, temperature: float) -> Tensor:
    """Returns tau log 1/M sum_m exp(Q_m / tau) / p_m of each critic's own values, [K, J, B].

    Args:
        values: of sampled actions, [K, J, B, M].
        log_density: of the samples, log p, [K, B, M].
        temperature: tau; small, it is nearly the largest value, large, the mean and a constant.
    """
    weighted = values / temperature - log_density[:, None]
    return temperature * (weighted.logsumexp(-1) - math.log(values.shape[-1]))


def cql_gap(samples: Samples, values: Tensor, q: Tensor, temperature: float) -> Tensor:
    """Returns gap_j, the penalty of each critic, as a mean over rows, [K, J].

    Args:
        samples: the sampled actions.
        values: what the critics give for them, [K, J, B, M].
        q: what they give for the data's actions, [K, J, B].
        temperature: tau of the soft maximum.
    """
    return (soft_maximum(values, samples.log_density, temperature) - q).mean(2)


class PenaltyConfig(Protocol):
    """Settings of a sampled penalty."""

    @property
    def n_samples(self) -> int: ...  # for each row, M
    @property
    def temperature(self) -> float: ...  # tau of the soft maximum


def counterfactual_gap(
    critics: JointCritics,
    generators: Sequence[torch.Generator],
    config: PenaltyConfig,
    x: Tensor,
    actions: Tensor,
    q: Tensor,
) -> Tensor:
    """Returns sum_i 1/N [tau log integral exp(Q_j(x, (b, a_-i)) / tau) db - Q_j(x, a)], [K, J].

    (Shao et al. 2023, equations 5 and 6 with even weights.) The sum is estimated by one agent i,
    drawn evenly for each row.

    Args:
        critics: whose values are penalized.
        generators: of agents and their actions, one per seed, [K].
        config: settings of the penalty.
        x: what the critics see, [K, B, S + N O].
        actions: of the data, [K, B, N, A].
        q: what the critics give for them, [K, J, B].
    """
    agents = draw_agents(generators, actions)  # [K, B, N]
    samples = counterfactual_samples(generators, actions, agents, config.n_samples)
    values = critics.sampled_q(x, samples.actions)[..., 0]  # [K, J, B, M]
    return cql_gap(samples, values, q, config.temperature)


def _repeated(actions: Tensor, n_samples: int) -> Tensor:
    return actions[:, :, None].expand(-1, -1, n_samples, -1, -1)
