"""Multilayer perceptrons of many seeds at once: every weight has a leading axis of networks.

The weights of R networks lie in one buffer [R, P], one network per row, and named weights are views
into it. So a layer is one batched product, Adam and Polyak averaging are one fused call each, and
the norm of a network's gradient is the norm of a row.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple, Protocol, Self

import torch
from torch import Tensor
from torch.nn.functional import layer_norm

from swarmdata.errors import CheckpointError
from swarmdata.numerics.random import derive

Initialization = Literal["uniform", "orthogonal"]


class Layer(NamedTuple):
    """Weights of one layer of R networks; scale and shift belong to its LayerNorm, if any."""

    weight: Tensor  # [R, inputs, outputs]
    bias: Tensor  # [R, 1, outputs]
    scale: Tensor | None = None  # [R, 1, outputs]
    shift: Tensor | None = None  # [R, 1, outputs]


def present(layer: Layer) -> list[Tensor]:
    """Returns the tensors that a layer has, in order."""
    return [tensor for tensor in layer if tensor is not None]


@dataclass(frozen=True, slots=True)
class MLPShape:
    """Sizes of a perceptron with ReLU after every hidden layer."""

    inputs: int
    hidden: tuple[int, ...]
    outputs: int
    layer_norm: bool = False  # before each ReLU

    def layers(self) -> Iterator[tuple[int, int, bool]]:
        """Yields inputs, outputs and presence of a LayerNorm, layer by layer."""
        sizes = (self.inputs, *self.hidden, self.outputs)
        for index, (n_in, n_out) in enumerate(pairwise(sizes)):
            yield n_in, n_out, self.layer_norm and index < len(self.hidden)


class Shape(Protocol):
    """Sizes of the layers of a kind of network."""

    def layers(self) -> Iterator[tuple[int, int, bool]]: ...  # as `MLPShape.layers`


def n_parameters(shape: Shape) -> int:
    """Returns the parameters of one network, P."""
    return sum(i * o + o + 2 * o * has_norm for i, o, has_norm in shape.layers())


LINE = 16
"""Numbers in a cache line of 64 bytes, a whole number of vectors."""


def unpadded(padded: Tensor, size: Sequence[int]) -> Tensor:
    """Returns the rows [R, P] of a buffer of whole cache lines, as a view."""
    return padded[: math.prod(size)].view(*size)


class StackedLayers:
    """The weights of R independent networks of one shape, and their gradients.

    Attributes:
        flat: the parameters, one network per row, [R, P].
        gradient: their gradient, [R, P].
        layers: the same memory as named weights that autograd differentiates.
        padded: the same memory in whole cache lines, one axis, with its gradient as `grad`.
    """

    def __init__(self, shape: Shape, n_networks: int, device: torch.device | str) -> None:
        self.shape = shape
        size = (n_networks, n_parameters(shape))
        # Adam(fused=True) ignores the strides of gradients on the CPU, so the gradient is one
        # contiguous buffer, which `backward` fills. It rounds what is left after the last whole
        # vector otherwise, so that buffers end with a cache line, whatever the number of networks.
        n_lines = -(-math.prod(size) // LINE)
        self.padded = torch.zeros(n_lines * LINE, device=device)
        self.padded.grad = torch.zeros_like(self.padded)
        self.flat = unpadded(self.padded, size)
        self.gradient = unpadded(self.padded.grad, size)
        self._frozen = _views(shape, self.flat)
        self.layers = [
            Layer(*(weight.detach().requires_grad_() for weight in present(layer)))
            for layer in self._frozen
        ]
        self._gradients = _views(shape, self.gradient)

    def constants(self, every: int = 1) -> list[Layer]:
        """Returns the weights of each `every`-th network, from the first, as constants."""
        return [Layer(*(w[::every] for w in present(layer))) for layer in self._frozen]

    def backward(self, loss: Tensor) -> None:
        backward(loss, [self])

    def extract(self, row: int, dtype: torch.dtype, n_rows: int = 1) -> list[Layer]:
        """Returns a copy of the weights of R = `n_rows` networks from `row` on, on the CPU."""
        copy = self.flat[row : row + n_rows].to("cpu", dtype, copy=True)
        return _views(self.shape, copy)

    def _leaves(self) -> list[tuple[Tensor, Tensor]]:
        """Every named weight with the memory of its gradient."""
        weights = [weight for layer in self.layers for weight in present(layer)]
        buffers = [buffer for layer in self._gradients for buffer in present(layer)]
        return list(zip(weights, buffers, strict=True))

    def load(self, flat: Tensor) -> None:
        """Replaces the parameters.

        Raises:
            CheckpointError: they are of other networks.
        """
        if flat.shape != self.flat.shape:
            raise CheckpointError(
                f"parameters have shape {tuple(flat.shape)}, expected {tuple(self.flat.shape)}: "
                "they belong to another number of seeds or other layer sizes"
            )
        self.flat.copy_(flat)

    def load_layers(self, rows: slice, layers: Sequence[Layer]) -> None:
        own = [[part[rows] for part in present(layer)] for layer in self._frozen]
        given = [present(layer) for layer in layers]
        shapes = [[[part.shape for part in layer] for layer in side] for side in (own, given)]
        if shapes[0] != shapes[1]:
            raise CheckpointError(f"weights have shapes {shapes[1]}, expected {shapes[0]}")
        for mine, theirs in zip(own, given, strict=True):
            for part, other in zip(mine, theirs, strict=True):
                part.copy_(other)

    def clone(self) -> Self:
        copy = type(self)(self.shape, len(self.flat), self.flat.device)
        copy.flat.copy_(self.flat)
        return copy


class StackedMLP(StackedLayers):
    """R independent perceptrons of one shape, trained and evaluated together."""

    shape: MLPShape

    def __call__(self, inputs: Tensor) -> Tensor:
        """Returns the outputs, [R, B, outputs], of inputs [R, B, inputs]."""
        return mlp(self.layers, inputs)

    def frozen(self, inputs: Tensor, every: int = 1) -> Tensor:
        """Returns outputs of each `every`-th network, its weights being constants.

        Inputs are [R / every, B, inputs].
        """
        return mlp(self.constants(every), inputs)


def backward(loss: Tensor, networks: Sequence[StackedLayers]) -> None:
    """Fills the gradients of several networks with those of one scalar loss, in one pass."""
    leaves = [pair for network in networks for pair in network._leaves()]
    gradients = torch.autograd.grad(loss, [weight for weight, _ in leaves])
    for (_, buffer), gradient in zip(leaves, gradients, strict=True):
        buffer.copy_(gradient)


def move_target(target: StackedLayers, online: StackedLayers, rate: float) -> None:
    """Moves the target's parameters by `rate` of their distance to the online ones, in place."""
    target.flat.lerp_(online.flat, rate)


def affine(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Returns x weight + bias of R networks, [R, B, outputs]; arguments as in `Layer`."""
    return torch.bmm(x, weight).add_(bias)


def mlp(layers: Sequence[Layer], inputs: Tensor) -> Tensor:
    """Returns the outputs, [R, B, outputs], of R networks on inputs [R, B, inputs]."""
    x = inputs
    for layer in layers[:-1]:
        x = _activate(layer, affine(x, layer.weight, layer.bias))
    head = layers[-1]
    if head.weight.shape[-1] == 1:
        # a product with one column runs at a tenth of the speed of a fused reduction
        return (x * head.weight.transpose(1, 2)).sum(-1, keepdim=True) + head.bias
    return affine(x, head.weight, head.bias)


def mlp_of_branches(layers: Sequence[Layer], shared: Tensor, varied: Tensor) -> Tensor:
    """Returns the outputs, [R, B, M, outputs], of networks on M inputs that begin alike in a row.

    The first layer is linear: its product with what is `shared`, [R, B, inputs - D], is made once,
    not M times; the rest is `varied`, [R, B, M, D]. There is a hidden layer at least.
    """
    first, n_shared, n_branches = layers[0], shared.shape[2], varied.shape[2]
    common = affine(shared, first.weight[:, :n_shared], first.bias)
    own = torch.bmm(varied.flatten(1, 2), first.weight[:, n_shared:])
    outputs = mlp_of_products(layers, common.repeat_interleave(n_branches, 1).add_(own))
    return outputs.view(len(outputs), -1, n_branches, outputs.shape[2])


def mlp_of_products(layers: Sequence[Layer], products: Tensor) -> Tensor:
    """Returns the outputs, [R, B, outputs], of networks with a hidden layer at least.

    `products` are inputs times the first layer's weight, plus its bias, [R, B, H]; overwritten.
    """
    return mlp(layers[1:], _activate(layers[0], products))


def _activate(layer: Layer, x: Tensor) -> Tensor:
    """Returns what a hidden layer gives of its products; overwrites them."""
    if layer.scale is not None and layer.shift is not None:
        size = x.shape[-1]
        # torch is twice as fast where layer_norm has weights, here ones that no seed changes
        standard = layer_norm(x, (size,), x.new_ones(size), x.new_zeros(size))
        x = torch.addcmul(layer.shift, standard, layer.scale)
    return x.relu_()


def initialize(
    network: StackedLayers,
    seeds: Sequence[int],
    stream: int,
    *,
    method: Initialization = "uniform",
    head_gain: float = 1.0,
) -> None:
    """Draws the parameters of the networks from their seeds, so that seed k never depends on K.

    `uniform` is torch.nn.Linear's default, U(-b, b) with b = 1 / sqrt(inputs) for weights and
    biases. `orthogonal` is Saxe et al. 2014 with gain sqrt(2) for ReLU layers, `head_gain` for the
    last one, and zero biases. Rows of a seed are neighbors, as many for each; `stream` separates
    the draws of different networks of one seed.
    """
    per_seed, rest = divmod(len(network.flat), len(seeds))
    if rest:
        raise ValueError(f"{len(network.flat)} networks do not divide among {len(seeds)} seeds")
    fresh = torch.empty_like(network.flat, device="cpu")
    for row in range(len(fresh)):
        seed = int(derive(seeds[row // per_seed], stream, row % per_seed)[0])
        generator = torch.Generator().manual_seed(seed)
        layers = _views(network.shape, fresh[row : row + 1])
        for layer in layers:
            gain = head_gain if layer is layers[-1] else None
            _draw(layer, generator, method, gain)
    network.flat.copy_(fresh)


def _draw(
    layer: Layer, generator: torch.Generator, method: Initialization, head_gain: float | None
) -> None:
    bound = 1 / math.sqrt(layer.weight.shape[1])
    if method == "orthogonal":
        gain = math.sqrt(2.0) if head_gain is None else head_gain
        torch.nn.init.orthogonal_(layer.weight[0], gain, generator=generator)
        layer.bias.zero_()
    else:
        layer.weight.uniform_(-bound, bound, generator=generator)
        layer.bias.uniform_(-bound, bound, generator=generator)
        if head_gain is not None:
            layer.weight.mul_(head_gain)
            layer.bias.mul_(head_gain)
    if layer.scale is not None and layer.shift is not None:
        layer.scale.fill_(1.0)
        layer.shift.zero_()


def _views(shape: Shape, flat: Tensor) -> list[Layer]:
    layers, start = [], 0
    for n_in, n_out, has_norm in shape.layers():
        rows = (n_in, 1, 1, 1) if has_norm else (n_in, 1)
        parts = []
        for n_rows in rows:
            end = start + n_rows * n_out
            parts.append(flat[:, start:end].view(len(flat), n_rows, n_out))
            start = end
        layers.append(Layer(*parts))
    return layers
