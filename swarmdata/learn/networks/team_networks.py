"""The networks of a team: one that all robots share and that sees their number, or one for each."""

from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor

from swarmdata.learn.networks.network_inputs import with_agent_id
from swarmdata.learn.networks.perceptrons import Layer, MLPShape, StackedMLP, initialize, mlp

Parameters = Literal["shared", "separate"]
"""One network for all robots of a seed, or one for each robot."""


class Team:
    """Maps what each robot sees to what it answers, for the teams of N robots of K seeds.

    `shape` has inputs without the robot's number. `shared` networks see a one-hot one; of
    `separate` ones, rows are seed 0 robot 0, seed 0 robot 1, ... Each seed may have J = `n_critics`
    teams, which are neighbors; K is then J times the number of seeds. `stream` separates the draws
    of initial parameters of different networks of one seed.
    """

    def __init__(
        self,
        shape: MLPShape,
        n_agents: int,
        seeds: Sequence[int],
        stream: int,
        *,
        parameters: Parameters,
        device: torch.device | str,
        n_critics: int = 1,
    ) -> None:
        self.parameters, self.n_agents = parameters, n_agents
        is_shared = parameters == "shared"
        self.n_rows = 1 if is_shared else n_agents  # networks of one seed
        n_inputs = shape.inputs + (n_agents if is_shared else 0)
        full = MLPShape(n_inputs, shape.hidden, shape.outputs, shape.layer_norm)
        self.network = StackedMLP(full, len(seeds) * n_critics * self.n_rows, device)
        initialize(self.network, seeds, stream)

    def __call__(self, features: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns outputs, [K, B, N, outputs], of normalized [K, B, N, F]; `network`: a copy."""
        outputs = (network or self.network)(to_rows(features, self.parameters))
        return from_rows(outputs, features.shape, self.parameters)

    def extract(self, index: int, n_critics: int = 1) -> list[Layer]:
        """Returns a copy of the J teams of seed number `index`, float64, on the CPU."""
        n_rows = n_critics * self.n_rows
        return self.network.extract(index * n_rows, torch.float64, n_rows)


def answer(layers: Sequence[Layer], features: Tensor, parameters: Parameters) -> Tensor:
    """Returns what the networks of one seed answer, [B, N, outputs], to features [B, N, F]."""
    rows = features[None]
    return from_rows(mlp(layers, to_rows(rows, parameters)), rows.shape, parameters)[0]


def to_rows(features: Tensor, parameters: Parameters) -> Tensor:
    """Returns features [K, B, N, F] by network: shared [K, B N, F + N], separate [K N, B, F]."""
    return by_network(with_agent_id(features) if parameters == "shared" else features, parameters)


def by_network(values: Tensor, parameters: Parameters) -> Tensor:
    """Returns values [K, B, N, ...] by network: shared [K, B N, ...], separate [K N, B, ...]."""
    if parameters == "shared":
        return values.flatten(1, 2)
    return values.transpose(1, 2).flatten(0, 1)


def from_rows(outputs: Tensor, shape: Sequence[int], parameters: Parameters) -> Tensor:
    """Returns outputs by robot, [K, B, N, outputs]; undoes `by_network` of `shape` (K, B, N, F)."""
    k, b, n = shape[:3]
    if parameters == "shared":
        return outputs.view(k, b, n, -1)
    return outputs.view(k, n, b, -1).transpose(1, 2)
