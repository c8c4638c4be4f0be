"""Sequence networks of many seeds: retention over time, attention over the robots before.

A token is a robot in a step: what it observes, and its number. With a residual stream h_{t,i} of
`width` numbers, parameter-free layer norms n, and H heads, of which head h forgets at the rate
gamma_h = 1 - 2^-(1+h):

    h      = relu(W_e x_{t,i})
    h     += W_o [(1 - gamma_h) sum_{s <= t} gamma_h^(t-s) (q_t . k_s) / sqrt(d_h) v_s]_h
    h     += W_2 relu(W_1 n(h))
    h     += W_p [sum_{j < i} p_ij v_ij]_h,   p_ij = exp(q_i . k_ij / sqrt(d_h)) / (1 + sum_j exp)
    h     += W_4 relu(W_3 n(h))

The first sum is retention (Sun et al. 2023, "Retentive network", equations 5 and 6): over a window
as a product of matrices, and when acting as a memory of H matrices, S <- gamma S + k^T v. Queries,
keys and values are linear in h and n(h); k_ij and v_ij also in what robot i was told of the action
that robot j has just chosen. The 1 in the quotient is a robot that says nothing.

`SequenceActor` tells every robot the actions of the robots before it, turned into its own frame,
with the direction of the teller's frame.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import layer_norm

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.memory_settings import WindowSettings
from swarmdata.learn.memory.segments import learned_rows, learned_steps, take
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.perceptrons import Layer, StackedLayers, affine, initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.perception.frames import Frame
from swarmdata.types import Batch

EMBED, TIME, TIME_OUT, TIME_IN, TIME_FORTH, ROBOTS, TOLD, ROBOTS_OUT, IN, FORTH, HEAD = range(11)
"""Places of the layers."""


@dataclass(frozen=True, slots=True)
class SequenceShape:
    """Sizes of a sequence network."""

    inputs: int  # F of a token, the robot's number included
    told: int  # D, numbers of an action of another robot
    width: int  # of the residual stream
    n_heads: int  # H, a divisor of the width
    outputs: int

    def layers(self) -> Iterator[tuple[int, int, bool]]:
        """Yields inputs, outputs and presence of a LayerNorm, in the order of the places."""
        width, wide = self.width, 2 * self.width
        yield self.inputs, width, False
        yield width, 3 * width, False
        yield width, width, False
        yield width, wide, False
        yield wide, width, False
        yield width, 3 * width, False
        yield self.told, 2 * width, False
        yield width, width, False
        yield width, wide, False
        yield wide, width, False
        yield width, self.outputs, False


class StackedSequences(StackedLayers):
    """R independent sequence networks."""

    shape: SequenceShape


def memory_size(width: int, n_heads: int) -> int:
    """Returns the numbers that a robot remembers, H matrices of d_h by d_h."""
    return width * width // n_heads


def decays(n_heads: int, like: Tensor) -> Tensor:
    """Returns gamma of each head, [H]."""
    return 1 - 0.5 ** torch.arange(1, n_heads + 1, dtype=like.dtype, device=like.device)


def over_window(
    layers: Sequence[Layer], inputs: Tensor, mask: Tensor, n_heads: int
) -> tuple[Tensor, Tensor]:
    """Returns the tokens of windows as embedded, and what they recall, both [R, B, L, N, width].

    Inputs are [R, B, L, N, F]; the mask, [R, B, L], is False on padding, which nobody recalls.
    """
    n_steps = inputs.shape[2]
    embedded, q, k, v = (each.transpose(2, 3) for each in _embedded(layers, inputs))
    # each [R, B, N, H, L, d_h] from here on
    q, k, v = (_by_head(each, n_heads).transpose(3, 4) for each in (q, k, v))
    gammas = decays(n_heads, inputs)[:, None, None]
    times = torch.arange(n_steps, device=inputs.device)
    ages = times[:, None] - times
    weights = (1 - gammas) / math.sqrt(q.shape[-1]) * gammas ** ages.clamp(min=0)  # [H, L, L]
    weights = weights * (ages >= 0) * mask[:, :, None, None, None]  # [R, B, 1, H, L, L]
    recalled = (q @ k.transpose(-1, -2) * weights) @ v
    return embedded.transpose(2, 3), recalled.permute(0, 1, 4, 2, 3, 5).flatten(4)


def over_step(
    layers: Sequence[Layer], inputs: Tensor, memory: Tensor, n_heads: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Takes in one step of inputs [R, B, N, F], with the memory before it, [R, B, N, M].

    Returns tokens as embedded, what they recall, both [R, B, N, width], and the memory after it.
    """
    embedded, q, k, v = _embedded(layers, inputs)
    q, k, v = (_by_head(each, n_heads) for each in (q, k, v))  # [R, B, N, H, d_h]
    gammas, size = decays(n_heads, inputs)[:, None], q.shape[-1]
    before = memory.view(*memory.shape[:-1], n_heads, size, size)
    after = gammas[..., None] * before + k[..., :, None] * v[..., None, :]
    recalled = (q[..., None, :] @ after)[..., 0, :] * ((1 - gammas) / math.sqrt(size))
    return embedded, recalled.flatten(-2), after.flatten(-3)


def _embedded(layers: Sequence[Layer], inputs: Tensor) -> tuple[Tensor, ...]:
    """Embedded tokens, and their queries, keys and values of retention, [..., width] each."""
    embedded = _linear(layers[EMBED], inputs).relu()
    return embedded, *_linear(layers[TIME], embedded).chunk(3, -1)


def with_past(layers: Sequence[Layer], embedded: Tensor, recalled: Tensor) -> Tensor:
    """Returns tokens that know their past, [R, B, N, width]; arguments likewise."""
    h = embedded + _linear(layers[TIME_OUT], recalled)
    return h + _feed_forward(layers[TIME_IN], layers[TIME_FORTH], h)


def decide(
    layers: Sequence[Layer], tokens: Tensor, told: Tensor, hears: Tensor, n_heads: int
) -> Tensor:
    """Returns the outputs of the last Q of N robots, [R, B, Q, outputs].

    Tokens, [R, B, N, width], are of the robots that decide and those before them; `told` are the
    actions of all as each that decides is told of them, [R, B, Q, N, D]; `hears` whom it hears,
    bool [Q, N].
    """
    n_deciding = hears.shape[0]
    q, k, v = _linear(layers[ROBOTS], _norm(tokens)).chunk(3, -1)
    told_k, told_v = _linear(layers[TOLD], told).chunk(2, -1)  # [R, B, Q, N, width]
    pairs = ((k[:, :, None] + told_k), (v[:, :, None] + told_v))
    k, v = (_by_head(each, n_heads) for each in pairs)  # [R, B, Q, N, H, d_h]
    own = tokens[:, :, -n_deciding:]
    q = _by_head(q[:, :, -n_deciding:, None], n_heads)  # [R, B, Q, 1, H, d_h]
    scores = (q * k).sum(-1) / math.sqrt(q.shape[-1])  # [R, B, Q, N, H]
    scores = scores.masked_fill(~hears[..., None], -torch.inf)
    silent = torch.zeros_like(scores[..., :1, :])
    weights = torch.cat([silent, scores], 3).softmax(3)[..., 1:, :]
    heard = (weights[..., None] * v).sum(3).flatten(-2)  # [R, B, Q, width]
    h = own + _linear(layers[ROBOTS_OUT], heard)
    h = h + _feed_forward(layers[IN], layers[FORTH], h)
    return _linear(layers[HEAD], _norm(h))


def earlier(n_agents: int, device: torch.device | str) -> Tensor:
    """Returns whom each robot hears, those before it, bool [N, N]."""
    return torch.ones(n_agents, n_agents, dtype=torch.bool, device=device).tril(-1)


def _by_head(values: Tensor, n_heads: int) -> Tensor:
    """Returns values [..., width] as [..., H, d_h]."""
    return values.reshape(*values.shape[:-1], n_heads, -1)


def _linear(layer: Layer, x: Tensor) -> Tensor:
    """Returns x weight + bias of R networks, x with any axes between the first and the last."""
    rows = x.reshape(len(x), -1, x.shape[-1])
    return affine(rows, layer.weight, layer.bias).view(*x.shape[:-1], -1)


def _feed_forward(first: Layer, second: Layer, h: Tensor) -> Tensor:
    return _linear(second, _linear(first, _norm(h)).relu())


def _norm(x: Tensor) -> Tensor:
    normed: Tensor = layer_norm(x, x.shape[-1:])
    return normed


class Mixture(NamedTuple):
    """Mixtures of M Gaussians of one fixed deviation sigma, over actions of A numbers.

        p(a) ~ sum_m w_m exp(-|a - mu_m|^2 / 2 sigma^2)

    With one component, the likelihood is a squared error.
    """

    log_weights: Tensor  # [..., M]
    means: Tensor  # [..., M, A]

    @classmethod
    def of(cls, outputs: Tensor, n_components: int) -> "Mixture":
        """Reads the mixtures from a network's outputs, [..., M (1 + A)]; means are in [-1, 1]."""
        logits, means = outputs[..., :n_components], outputs[..., n_components:]
        shaped = means.reshape(*means.shape[:-1], n_components, -1)
        return cls(logits.log_softmax(-1), shaped.tanh())

    def surprise(self, actions: Tensor, deviation: float) -> Tensor:
        """Returns -2 sigma^2 / A log p(a), but for a constant, [...], of actions [..., A]."""
        exponents = self.log_weights + _exponents(actions[..., None, :] - self.means, deviation)
        return exponents.logsumexp(-1) * (-2 * deviation**2 / actions.shape[-1])

    def mode(self, deviation: float) -> Tensor:
        """Returns the mean at which the density is largest, [..., A]."""
        between = self.means[..., :, None, :] - self.means[..., None, :, :]  # [..., M, M, A]
        shares = self.log_weights.exp()[..., None, :] * _exponents(between, deviation).exp()
        best = shares.sum(-1).argmax(-1)  # [...]
        index = best[..., None, None].expand(*best.shape, 1, self.means.shape[-1])
        return torch.gather(self.means, -2, index)[..., 0, :]


def _exponents(differences: Tensor, deviation: float) -> Tensor:
    return (differences * differences).sum(-1) * (-0.5 / deviation**2)


@dataclass(frozen=True)
class SequenceSettings(WindowSettings):
    """Settings of policies that act in sequence."""

    window: int = 10  # with 10 steps of burn-in, a robot learns with 10 to 20 steps of its past
    width: int = 64  # of a token
    n_heads: int = 4  # of each attention; the slowest forgets half of a step in 11 steps
    n_components: int = 4  # modes of a robot's action
    deviation: float = 0.2  # of each mode; what is nearer than that is one mode
    joint: bool = True  # whether robots hear those before them; without, each acts alone

    def __post_init__(self) -> None:
        if self.n_heads < 1 or self.width < 1 or self.width % self.n_heads:
            raise SchemaError(
                f"got width={self.width} and n_heads={self.n_heads}, expected a width that is a "
                "multiple of the number of heads"
            )
        if self.n_components < 1 or self.deviation <= 0:
            raise SchemaError(
                f"got n_components={self.n_components} and deviation={self.deviation}, expected at "
                "least 1 and above 0"
            )


class SequenceActor:
    """Maps all observations of an episode so far, and the actions of robots before, to mixtures."""

    def __init__(self, setup: Setup, settings: SequenceSettings) -> None:
        sizes = setup.sizes
        self.shape = SequenceShape(
            inputs=sizes.observation + sizes.n_agents,
            told=sizes.action + (0 if sizes.frame is None else 2),
            width=settings.width,
            n_heads=settings.n_heads,
            outputs=settings.n_components * (1 + sizes.action),
        )
        self.network = StackedSequences(self.shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        self.settings, self.sizes = settings, sizes
        self._hears = earlier(sizes.n_agents, setup.device) & settings.joint
        self.standard = Standardization.of(setup.statistics, setup.device)

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns the transitions to learn from, fields [K, R, ...], and the outputs there.

        The batch has windows [K, B, L, ...]; R is B times the steps of a segment.
        """
        layers, n_heads = self.network.layers, self.settings.n_heads
        rows = learned_rows(batch.mask, self.settings.window)
        steps = learned_steps(batch, rows)
        seen = self.standard(batch.observations).masked_fill(~batch.mask[..., None, None], 0.0)
        embedded, recalled = over_window(layers, with_agent_id(seen), batch.mask, n_heads)
        tokens = with_past(layers, take(embedded, rows), take(recalled, rows))
        told = told_actions(self.sizes.frame, steps.observations, steps.actions)
        return steps, decide(layers, tokens, told, self._hears, n_heads)


def told_actions(frame: Frame | None, observations: Tensor, actions: Tensor) -> Tensor:
    """Returns what each robot is told of each action, [..., N, N, D]; tellers are the last but one.

    Observations [..., N, O], not normalized, and actions [..., N, A] are each in the frame of their
    robot; without a frame, in the world's.
    """
    n_agents = actions.shape[-2]
    told = actions[..., None, :, :].expand(*actions.shape[:-2], n_agents, -1, -1)
    if frame is None:
        return told
    axis = observations.shape[-1] - frame.n_added
    ux, uy = observations[..., axis, None], observations[..., axis + 1, None]  # [..., N, 1]
    wx, wy = ux.transpose(-1, -2), uy.transpose(-1, -2)
    cosines, sines = ux * wx + uy * wy, ux * wy - uy * wx  # [..., N, N]
    x, y = told[..., 0], told[..., 1]
    turned = torch.stack([cosines * x - sines * y, sines * x + cosines * y], -1)
    turns = torch.from_numpy(frame.turns(n_agents)).to(told.device)[:, None]  # of the tellers
    told = torch.cat([torch.where(turns, turned, told[..., :2]), told[..., 2:]], -1)
    return torch.cat([told, cosines[..., None], sines[..., None]], -1)
