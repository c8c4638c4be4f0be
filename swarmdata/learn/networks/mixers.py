"""Mixers: the team's value as a function of its robots' values, for K seeds at once.

A mixer that never falls when a robot's value rises lets every robot act greedily on its own and the
team be greedy nevertheless (individual-global-max, Rashid et al. 2018, equation 4).
"""

from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import torch
from torch import Tensor
from torch.nn.functional import elu

from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup

Network = Callable[[Tensor], Tensor]
"""Stacked networks, or some of them with their weights as constants."""


class Mixer(Protocol):
    """Mixes values, perhaps by the state; `network` has what is learned, None if nothing is."""

    @property
    def network(self) -> StackedMLP | None: ...

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        """Returns team values, [K, B], of the robots' [K, B, N] and normalized states [K, B, S]."""
        ...


class MeanMixer:
    """VDN (Sunehag et al. 2018, section 3), with the mean for the sum: team rewards are means."""

    network: StackedMLP | None = None

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        return values.mean(-1)


class HyperMixer:
    """A mixing network with one hidden layer, whose weights another network makes of the state.

        Q_tot = u(w_2(s))' elu(u(W_1(s))' q + b_1(s)) + v(s)

    Monotonic mixers are those of QMIX (Rashid et al. 2018, section 4.1 and figure 2): u is |.|. The
    others are FACMAC's nonmonotonic factorization (Peng et al. 2021, section 3.1), in which u
    changes nothing: actors need no greedy choice of the critic.

    W_1, b_1, w_2 and v are outputs of one perceptron of the state with a hidden layer. (In QMIX's
    paper they are separate networks, and only v has a hidden layer.) The values enter with the
    weights divided by N, so that their scale is independent of the size of the team.

    `stream` separates the draws of different networks of one seed; `embedding` is the width of the
    mixing network's hidden layer, M, `hidden` that of the hypernetwork's. Each seed has J =
    `n_critics` mixers, which are neighbors; K is J times the seeds when called.
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
        is_monotonic: bool = True,
    ) -> None:
        self.embedding, self._is_monotonic = embedding, is_monotonic
        self._sizes = [n_agents * embedding, embedding, embedding, 1]
        shape = MLPShape(state_size, (hidden,), sum(self._sizes))
        self.network = StackedMLP(shape, len(seeds) * n_critics, device)
        initialize(self.network, seeds, stream)

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        first, shift, second, bias = torch.split((network or self.network)(states), self._sizes, -1)
        if self._is_monotonic:
            first, second = first.abs(), second.abs()
        first = first.view(*values.shape, self.embedding)  # [K, B, N, M]
        mixed = (values[..., None] * first).mean(-2) + shift  # [K, B, M]
        return (elu(mixed) * second).sum(-1) + bias[..., 0]


MixerKind = Literal["mean", "monotonic", "free"]
"""`MeanMixer`, and the two kinds of `HyperMixer`."""

MIXER_NEEDS = dict.fromkeys(("mixer_embedding", "mixer_hidden"), ("mixer", ("monotonic", "free")))
"""`settings.Needs` of algorithms that choose a mixer."""

MIXER_STREAM = 2
"""Stream of a seed's initial parameters, beside those of `learn.networks.actor`."""


def chosen_mixer(setup: Setup, kind: MixerKind, embedding: int, hidden: int) -> Mixer:
    """Makes the mixers of two critics of each seed, by the state and all observations."""
    is_monotonic = {"mean": None, "monotonic": True, "free": False}[kind]
    return MeanMixer() if is_monotonic is None else HyperMixer(
        setup.sizes.n_agents, setup.sizes.information, setup.seeds, MIXER_STREAM,
        embedding=embedding, hidden=hidden, device=setup.device, n_critics=2,
        is_monotonic=is_monotonic,
    )  # fmt: skip


class LinearMixer:
    """OMIGA's mixing network (Wang et al. 2023; `MixNet` of the authors' code).

        Q_tot = sum_i w_i(s) Q_i + b(s)        w_i(s) = |1 + h_i(s)| / N

    h and b are outputs of one perceptron of s = (state, all observations) with one hidden layer. In
    the code w_i = |h_i|; with 1 / N a fresh mixer takes the mean.
    """

    def __init__(self, setup: Setup, hidden: int) -> None:
        self._n_agents = setup.sizes.n_agents
        shape = MLPShape(setup.sizes.information, (hidden,), self._n_agents + 1)
        self.network = StackedMLP(shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, MIXER_STREAM)

    def __call__(self, values: Tensor, states: Tensor, network: Network | None = None) -> Tensor:
        weights, bias = self.weights(states, network)
        return (weights * values).sum(-1) + bias

    def weights(self, states: Tensor, network: Network | None = None) -> tuple[Tensor, Tensor]:
        """Returns w, [K, B, N], at least 0, and b, [K, B]; arguments as of a call."""
        outputs = (network or self.network)(states)
        return (1 + outputs[..., :-1]).abs() / self._n_agents, outputs[..., -1]
