"""Mixers: the team's value as a function of its robots' values, for K seeds at once.

A mixer that never falls when a robot's value rises lets every robot act greedily on its own and the
team be greedy nevertheless (individual-global-max, Rashid et al. 2018, equation 4).
"""

from collections.abc import Sequence
from typing import Protocol

import torch
from torch import Tensor
from torch.nn.functional import elu

from swarmdata.learn.networks import MLPShape, StackedMLP, initialize


class Mixer(Protocol):
    """Mixes values, perhaps by the state; `network` has what is learned, None if nothing is."""

    network: StackedMLP | None

    def __call__(self, values: Tensor, states: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns team values, [K, B].

        Args:
            values: of the robots, [K, B, N].
            states: normalized, [K, B, S].
            network: other parameters to use, those of the target mixer.
        """
        ...


class MeanMixer:
    """VDN (Sunehag et al. 2018, section 3), with the mean for the sum.

    Rewards of a team are means over robots, so values keep their scale in teams of any size.
    """

    network: StackedMLP | None = None

    def __call__(self, values: Tensor, states: Tensor, network: StackedMLP | None = None) -> Tensor:
        return values.mean(-1)


class MonotonicMixer:
    """QMIX's mixing network (Rashid et al. 2018, section 4.1 and figure 2).

        Q_tot = |w_2(s)|' elu(|W_1(s)|' q + b_1(s)) + v(s)

    W_1, b_1, w_2 and v are outputs of one perceptron of the state with a hidden layer. (In the
    paper they are separate networks, and only v has a hidden layer.) The values enter with the
    weights divided by N, so that their scale is independent of the size of the team.

    Args:
        n_agents: N.
        state_size: S.
        seeds: of the initial parameters, [K].
        stream: separates the draws of different networks of one seed.
        embedding: width of the mixing network's hidden layer, M.
        hidden: width of the hypernetwork's hidden layer.
        device: where the parameters are.
        n_twins: mixers of each seed, J; K is then J times the number of seeds, twins are neighbors.
    """

    def __init__(
        self,
        n_agents: int,
        state_size: int,
        seeds: Sequence[int],
        stream: int,
        *,
        embedding: int,
        hidden: int,
        device: torch.device | str,
        n_twins: int = 1,
    ) -> None:
        self.embedding = embedding
        self._sizes = [n_agents * embedding, embedding, embedding, 1]
        shape = MLPShape(state_size, (hidden,), sum(self._sizes))
        self._hyper = StackedMLP(shape, len(seeds) * n_twins, device)
        initialize(self._hyper, seeds, stream)
        self.network: StackedMLP | None = self._hyper

    def __call__(self, values: Tensor, states: Tensor, network: StackedMLP | None = None) -> Tensor:
        parts = torch.split((network or self._hyper)(states), self._sizes, -1)
        first = parts[0].abs().view(*values.shape, self.embedding)  # [K, B, N, M]
        mixed = (values[..., None] * first).mean(-2) + parts[1]  # [K, B, M]
        return (elu(mixed) * parts[2].abs()).sum(-1) + parts[3][..., 0]
