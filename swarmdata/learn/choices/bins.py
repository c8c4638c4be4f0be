"""Continuous actions as choices among bins, one choice per dimension.

Factorized discretization of DecQN (Seyde et al., "Solving continuous control via Q-learning", ICLR
2023): a robot's utility is the mean over action dimensions of one utility per dimension,
so that D dimensions of C choices cost D C outputs and not C ** D.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.perceptrons import Layer, present
from swarmdata.learn.networks.team_networks import Parameters, answer


def bin_values(n_bins: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Returns evenly spaced action values from -1 to 1, [C]; an odd number has 0 among them."""
    if n_bins < 2:
        raise SchemaError(f"got {n_bins} bins, expected at least 2: the ends of [-1, 1]")
    return (2 * torch.arange(n_bins, dtype=dtype) - (n_bins - 1)) / (n_bins - 1)


def to_actions(choices: Tensor, n_bins: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Returns the action values of choices, [...], whole numbers below `n_bins`."""
    return bin_values(n_bins, dtype).to(choices.device)[choices]


def by_dimension(outputs: Tensor, n_choices: int) -> Tensor:
    """Returns utilities [..., D, C] of a network's outputs [..., D C]."""
    return outputs.reshape(*outputs.shape[:-1], -1, n_choices)


def chosen(utilities: Tensor, choices: Tensor) -> Tensor:
    """Returns Q_i, [...], the mean of the utilities [..., D, C] of choices, integers [..., D]."""
    return utilities.gather(-1, choices[..., None])[..., 0].mean(-1)


def places(actions: Tensor, n_bins: int) -> Tensor:
    """Returns where actions [...] lie among C = `n_bins` bins, 0 to C - 1; whole numbers are bins.

    Actions are in [-1, 1]; beyond, they count as the ends.
    """
    return (actions.clamp(-1, 1) + 1) * ((n_bins - 1) / 2)


def interpolated(utilities: Tensor, between: Tensor) -> Tensor:
    """Returns Q_i, [...]: the mean over columns of utilities [..., D, C] at `places` [..., D].

    Between two bins a utility is linear, as with the weights of `two_hot`.
    """
    below = between.floor().clamp(max=utilities.shape[-1] - 2)
    first = below.long()[..., None]
    weight = between - below
    ends = utilities.gather(-1, torch.cat([first, first + 1], -1))  # [..., D, 2]
    return torch.lerp(ends[..., 0], ends[..., 1], weight.to(ends.dtype)).mean(-1)


def two_hot(actions: Tensor, n_bins: int) -> Tensor:
    """Returns actions [..., D] as weights of their two nearest bins, [..., D, C], which sum to 1.

    The weighted mean of a column's utilities is then linear between bins. Such a function has its
    greatest value at a bin, so that greedy choices stay exact. Beyond [-1, 1], actions count as the
    ends.
    """
    place = places(actions, n_bins)
    below = place.detach().floor().clamp(max=n_bins - 2).long()
    weight = place - below  # how far an action is on the way to the next bin
    weights = actions.new_zeros(*actions.shape, n_bins)
    weights.scatter_(-1, below[..., None], 1 - weight[..., None])
    return weights.scatter_(-1, below[..., None] + 1, weight[..., None])


def mean_utilities(
    layers: Sequence[Layer], features: Tensor, parameters: Parameters, n_critics: int
) -> Tensor:
    """Returns the mean of what the critics of one seed answer, float64 [E, N, D C].

    Layers are critic after critic; features, which they see, float64 [E, N, F].
    """
    n_rows = len(layers[0].weight) // n_critics
    answers = []
    for critic in range(n_critics):
        own = rows_of(layers, slice(critic * n_rows, (critic + 1) * n_rows))
        answers.append(answer(own, features, parameters))
    return torch.stack(answers).mean(0)


def rows_of(layers: Sequence[Layer], rows: slice) -> list[Layer]:
    """Returns the weights of some networks."""
    return [Layer(*(weight[rows] for weight in present(each))) for each in layers]
