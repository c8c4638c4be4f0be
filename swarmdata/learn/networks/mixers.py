"""Mixers: the team's value as a function of its robots' values, for K seeds at once.

A mixer that never falls when a robot's value rises lets every robot act greedily on its own and the
team be greedy nevertheless (individual-global-max, Rashid et al. 2018, equation 4).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import torch
from torch import Tensor
from torch.nn.functional import elu

from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Sizes

Network = Callable[[Tensor], Tensor]
"""Stacked networks, or some of them with their weights as constants."""


class Mixer(Protocol):
    """Mixes values, perhaps by the state; `network` has what is learned, None if nothing is."""

    @property
    def network(self) -> StackedMLP | None: ...

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
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

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        return values.mean(-1)


class HyperMixer(ABC):
    """A mixing network with one hidden layer, whose weights another network makes of the state.

        Q_tot = u(w_2(s))' elu(u(W_1(s))' q + b_1(s)) + v(s)

    u is what subclasses do to weights. W_1, b_1, w_2 and v are outputs of one perceptron of the
    state with a hidden layer. (In QMIX's paper they are separate networks, and only v has a hidden
    layer.) The values enter with the weights divided by N, so that their scale is independent of
    the size of the team.

    Args:
        n_agents: N.
        state_size: S.
        seeds: of the initial parameters, [K].
        stream: separates the draws of different networks of one seed.
        embedding: width of the mixing network's hidden layer, M.
        hidden: width of the hypernetwork's hidden layer.
        device: where the parameters are.
        n_critics: mixers of each seed, J, which are neighbors; K is then J times the number of
            seeds.
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
        n_critics: int = 1,
    ) -> None:
        self.embedding = embedding
        self._sizes = [n_agents * embedding, embedding, embedding, 1]
        shape = MLPShape(state_size, (hidden,), sum(self._sizes))
        self._hyper = StackedMLP(shape, len(seeds) * n_critics, device)
        initialize(self._hyper, seeds, stream)
        self.network = self._hyper

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        parts = torch.split((network or self._hyper)(states), self._sizes, -1)
        first = self.weights(parts[0]).view(*values.shape, self.embedding)  # [K, B, N, M]
        mixed = (values[..., None] * first).mean(-2) + parts[1]  # [K, B, M]
        return (elu(mixed) * self.weights(parts[2])).sum(-1) + parts[3][..., 0]

    @staticmethod
    @abstractmethod
    def weights(outputs: Tensor) -> Tensor:
        """Returns u of what the hypernetwork gives for weights."""


class MonotonicMixer(HyperMixer):
    """QMIX's mixing network (Rashid et al. 2018, section 4.1 and figure 2): u is |.|."""

    @staticmethod
    def weights(outputs: Tensor) -> Tensor:
        return outputs.abs()


class FreeMixer(HyperMixer):
    """FACMAC's nonmonotonic factorization (Peng et al. 2021, section 3.1): u changes nothing.

    A robot's rise may lower the team's value. Actors need no greedy choice of the critic, so
    nothing asks for monotonicity.
    """

    @staticmethod
    def weights(outputs: Tensor) -> Tensor:
        return outputs


MixerKind = Literal["mean", "monotonic", "free"]
"""Names of `MeanMixer`, `MonotonicMixer` and `FreeMixer`."""

_LEARNED: dict[MixerKind, type[HyperMixer] | None] = {
    "mean": None,  # nothing is learned
    "monotonic": MonotonicMixer,
    "free": FreeMixer,
}


class MixerConfig(Protocol):
    """Settings of a mixer and of the network that makes its weights."""

    @property
    def mixer(self) -> MixerKind: ...
    @property
    def mixer_embedding(self) -> int: ...
    @property
    def mixer_hidden(self) -> int: ...


def chosen_mixer(
    config: MixerConfig,
    sizes: Sizes,
    seeds: Sequence[int],
    stream: int,
    device: torch.device | str,
    *,
    n_critics: int,
) -> Mixer:
    """Makes the mixers of J critics of each seed, by the state and all observations.

    Args:
        config: which mixer, and its widths.
        sizes: numbers of agents and features.
        seeds: of the initial parameters, [K].
        stream: separates the draws of different networks of one seed.
        device: where the parameters are.
        n_critics: J.
    """
    learned = _LEARNED[config.mixer]
    return MeanMixer() if learned is None else learned(
        sizes.n_agents, sizes.information, seeds, stream, embedding=config.mixer_embedding,
        hidden=config.mixer_hidden, device=device, n_critics=n_critics,
    )  # fmt: skip


class LinearMixer:
    """OMIGA's mixing network (Wang et al. 2023; `MixNet` of the authors' code).

        Q_tot = sum_i w_i(s) Q_i + b(s)        w_i(s) = |1 + h_i(s)| / N

    h and b are outputs of one perceptron of the state. (In the code w_i = |h_i|; the 1 / N lets a
    fresh mixer take the mean, so that values have the scale of the team's.)

    Args:
        n_agents: N.
        state_size: S.
        seeds: of the initial parameters, [K].
        stream: separates the draws of different networks of one seed.
        hidden: width of the perceptron's hidden layer.
        device: where the parameters are.
    """

    def __init__(
        self,
        n_agents: int,
        state_size: int,
        seeds: Sequence[int],
        stream: int,
        *,
        hidden: int,
        device: torch.device | str,
    ) -> None:
        self._n_agents = n_agents
        self._hyper = StackedMLP(MLPShape(state_size, (hidden,), n_agents + 1), len(seeds), device)
        initialize(self._hyper, seeds, stream)
        self.network = self._hyper

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        weights, bias = self.weights(states, network)
        return (weights * values).sum(-1) + bias

    def weights(self, states: Tensor, network: Network | None = None) -> tuple[Tensor, Tensor]:
        """Returns w, [K, B, N], at least 0, and b, [K, B]; arguments as of a call."""
        outputs = (network or self._hyper)(states)
        return (1 + outputs[..., :-1]).abs() / self._n_agents, outputs[..., -1]
