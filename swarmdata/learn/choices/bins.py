"""Continuous actions as choices among bins, one choice per dimension.

Factorized discretization of DecQN (Seyde et al., "Solving continuous control via Q-learning", ICLR
2023): a robot's utility is the mean over action dimensions of one utility per dimension,
so that D dimensions of C choices cost D C outputs and not C ** D.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.perceptrons import Layer
from swarmdata.learn.networks.team_networks import Parameters
from swarmdata.learn.policies.torch_policy import Memoryless, outputs_of
from swarmdata.perception.frames import Frame, in_world
from swarmdata.types import Float


def bin_values(n_bins: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Returns evenly spaced action values from -1 to 1, [C]; an odd number has 0 among them.

    Raises:
        SchemaError: fewer than 2 bins.
    """
    if n_bins < 2:
        raise SchemaError(f"got {n_bins} bins, expected at least 2: the ends of [-1, 1]")
    return (2 * torch.arange(n_bins, dtype=dtype) - (n_bins - 1)) / (n_bins - 1)


def to_actions(choices: Tensor, n_bins: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Returns the action values of choices, [...], whole numbers below `n_bins`."""
    return bin_values(n_bins, dtype).to(choices.device)[choices]


def by_dimension(outputs: Tensor, n_choices: int) -> Tensor:
    """Returns utilities [..., D, C] of a network's outputs [..., D C]."""
    return outputs.reshape(*outputs.shape[:-1], -1, n_choices)


def greedy(utilities: Tensor) -> Tensor:
    """Returns the best choice of every dimension, [..., D], of utilities [..., D, C]."""
    return utilities.argmax(-1)


def chosen(utilities: Tensor, choices: Tensor) -> Tensor:
    """Returns Q_i, the mean over dimensions of the chosen utilities, [...].

    Args:
        utilities: [..., D, C].
        choices: whole numbers, [..., D].
    """
    return utilities.gather(-1, choices[..., None])[..., 0].mean(-1)


def two_hot(actions: Tensor, n_bins: int) -> Tensor:
    """Returns actions as weights of their two nearest bins, [..., D, C], which sum to 1.

    The weighted mean of a column's utilities is then linear between bins. Such a function has its
    greatest value at a bin, so that greedy choices stay exact, and a recorded action needs no
    relabeling.

    Args:
        actions: in [-1, 1], beyond which they count as the ends, [..., D].
        n_bins: of each dimension, C.
    """
    place = (actions.clamp(-1, 1) + 1) * ((n_bins - 1) / 2)
    below = place.detach().floor().clamp(max=n_bins - 2).long()
    weight = place - below  # how far an action is on the way to the next bin
    weights = actions.new_zeros(*actions.shape, n_bins)
    weights.scatter_(-1, below[..., None], 1 - weight[..., None])
    return weights.scatter_(-1, below[..., None] + 1, weight[..., None])


@dataclass(frozen=True, slots=True, eq=False)
class BinPolicy(Memoryless):
    """Takes the best bin of every dimension; computes in float64, as `TorchPolicy` does.

    Attributes:
        layers: weights of the utility networks, float64; R = 1 if they are shared, else N.
        observation_mean: subtracted from observations, float64 [O].
        observation_std: what they are divided by, float64 [O].
        n_bins: of each dimension, C.
        frame: in which the robots see and act; None for the world's.
        parameters: whether the robots share one network.
    """

    layers: Sequence[Layer]
    observation_mean: Tensor
    observation_std: Tensor
    n_bins: int
    frame: Frame | None = None
    parameters: Parameters = "shared"
    uses_state: bool = False

    def actions(self, observations: Float) -> Float:
        """Returns joint actions, float32 [E, N, A], for observations [E, N, O].

        Raises:
            SchemaError: the observations are not those the policy was trained on.
        """
        actions = to_actions(self.choices(observations), self.n_bins, torch.float64)
        return in_world(self.frame, observations, actions.numpy()).astype(np.float32)

    def choices(self, observations: Float) -> Tensor:
        """Returns the best choices, whole numbers [E, N, D], for observations [E, N, O]."""
        framed = observations if self.frame is None else self.frame.inputs(observations)
        outputs = outputs_of(
            self.layers, framed, self.observation_mean, self.observation_std, self.parameters
        )
        return greedy(by_dimension(outputs, self.n_bins))
