"""Gated recurrent units of many seeds at once, with the perceptrons that read them.

Cho et al., "Learning phrase representations using RNN encoder-decoder for statistical machine
translation", EMNLP 2014, section 2.3, in the form of torch.nn.GRU. With input x and memory h:

    r  = sigmoid(W_ir x + b_ir + W_hr h + b_hr)
    z  = sigmoid(W_iz x + b_iz + W_hz h + b_hz)
    n  = tanh(W_in x + b_in + r (W_hn h + b_hn))
    h' = (1 - z) n + z h

The gates are two layers: one of inputs, one of memories, each with the outputs r, z, n.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.learn.networks.perceptrons import Layer, MLPShape, StackedLayers, affine, mlp

N_GATE_LAYERS = 2


@dataclass(frozen=True, slots=True)
class GatedShape:
    """Sizes of a gated unit, and of the perceptron that reads its inputs and its new memory."""

    inputs: int  # F
    memory: int  # M
    reader: MLPShape | None = None  # of F + M inputs or more; None: the memory is the output

    @classmethod
    def reading(cls, shape: MLPShape, memory: int) -> "GatedShape":
        """Returns a perceptron's shape with a memory of what it has seen beside its inputs."""
        reader = MLPShape(shape.inputs + memory, shape.hidden, shape.outputs, shape.layer_norm)
        return cls(shape.inputs, memory, reader)

    def layers(self) -> Iterator[tuple[int, int, bool]]:
        """Yields inputs, outputs and presence of a LayerNorm: the gates', then the reader's."""
        yield self.inputs, 3 * self.memory, False
        yield self.memory, 3 * self.memory, False
        if self.reader is not None:
            yield from self.reader.layers()


class StackedGates(StackedLayers):
    """R independent gated units, each with a reader if the shape has one."""

    shape: GatedShape

    def read(self, inputs: Tensor, memory: Tensor) -> Tensor:
        """Returns the reader's outputs, [R, B, outputs], of inputs [R, B, F] and [R, B, M]."""
        return read(self.layers, inputs, memory)


def memories(
    layers: Sequence[Layer], inputs: Tensor, starts: Tensor, first: Tensor | None = None
) -> Tensor:
    """Returns the memories after each step, [R, T, B, M], of inputs [R, T, B, F].

    `starts` tells whether the memory is empty before a step, bool [R, T, B]; `first` is the memory
    before the first step, [R, B, M], None an empty one.
    """
    n_rows, n_steps, n_batch = starts.shape
    gates = layers[0]
    driven = affine(inputs.flatten(1, 2), gates.weight, gates.bias)
    driven = driven.view(n_rows, n_steps, n_batch, -1)
    kept = (~starts)[..., None].to(inputs.dtype).unbind(1)
    memory = inputs.new_zeros(n_rows, n_batch, driven.shape[-1] // 3) if first is None else first
    history = []
    for now, keep in zip(driven.unbind(1), kept, strict=True):
        memory = _gated(layers[1], now, memory * keep)
        history.append(memory)
    return torch.stack(history, 1)


def next_memory(layers: Sequence[Layer], inputs: Tensor, memory: Tensor) -> Tensor:
    """Returns the memories after one step, [R, B, M], of inputs [R, B, F] and memories before."""
    gates = layers[0]
    return _gated(layers[1], affine(inputs, gates.weight, gates.bias), memory)


def read(layers: Sequence[Layer], inputs: Tensor, memory: Tensor) -> Tensor:
    """Returns the reader's outputs, [R, B, outputs], of inputs [R, B, F].

    The memory, [R, B, M], is that after the step; layers are the gates, then the reader.
    """
    return mlp(layers[N_GATE_LAYERS:], torch.cat([inputs, memory], -1))


def _gated(recurrent: Layer, driven: Tensor, memory: Tensor) -> Tensor:
    """Returns h', [R, B, M]: `driven` are the products of the inputs, [R, B, 3 M]."""
    size = memory.shape[-1]
    own = affine(memory, recurrent.weight, recurrent.bias)
    reset, update = (driven[..., : 2 * size] + own[..., : 2 * size]).sigmoid().chunk(2, -1)
    new = torch.addcmul(driven[..., 2 * size :], reset, own[..., 2 * size :]).tanh()
    return new + update * (memory - new)
