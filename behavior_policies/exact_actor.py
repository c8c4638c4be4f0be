"""Feed-forward actors, evaluated exactly: the same bits from every BLAS kernel.

No sum is ever rounded, so its order, which differs between kernels, thread counts and batches,
cannot matter. Weights and biases are multiples of 2^-12 of at most 2^15 steps, activations are
clipped to 2^18 such steps: a product is a multiple of 2^-24 of at most 2^33 steps, and a sum of
n <= `MAX_WIDTH` = 4096 of them and a bias is below 2^46, where float64 is exact up to 2^53. All
between the products is elementwise IEEE arithmetic. A kernel may return a zero of either sign;
adding +0 makes it +0. Loading a file checks these assumptions.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from swarmdata.errors import CheckpointError, SchemaError
from swarmdata.numerics.exact_math import tanh
from swarmdata.perception.frames import NO_HEADING, Frame, in_world
from swarmdata.runtime.atomic import write_file
from swarmdata.types import Double, Float

STEPS_PER_UNIT = 2.0**12  # steps per unit of weights and activations
MAX_WEIGHT = 8.0 - 2.0**-12  # 16 bits
MAX_ACTIVATION = 64.0
MAX_WIDTH = 4096

FRAME_TENSORS = ("frame.anchor", "frame.vectors", "frame.closing")
"""Tensors of an actor that observes and acts in a frame of its own."""

HEARD_TENSOR = "frame.heard"  # one more tensor, of an actor that receives messages
BODY_TENSOR = "frame.body"  # [1] of ones, of an actor of unicycles: the anchor is their heading

MIXED_TENSOR = "frame.mixed"
"""One more tensor, [1 + K], of an actor of K holonomic robots and of unicycles: the index of the
heading, then these robots."""

SQUASH_TENSOR = "output.tanh"  # [1] of ones, of an actor whose outputs pass through tanh
Layer = tuple[Double, Double]  # weight [in, out], bias [out]


class Actor(NamedTuple):
    """A checked feed-forward network with ReLU between its layers."""

    mean: Double  # [O] subtracted from the inputs
    scale: Double  # [O] by which they are then multiplied
    layers: tuple[Layer, ...]
    n_agents: int  # N if a one-hot robot index follows, else 0
    frame: Frame | None  # in which it observes and acts; None for the world's
    squash: bool = False  # whether its outputs pass through tanh


def forward(actor: Actor, observations: Float) -> Double:
    """Returns mean actions in [-1, 1], [E, N, A], multiples of 2^-12, of observations [E, N, O]."""
    n_copies, n_agents, size = observations.shape
    expected = len(actor.mean) - (0 if actor.frame is None else actor.frame.n_added)
    if size != expected:
        raise SchemaError(
            f"observations have {size} features, the actor expects {expected}. "
            "Use the observation model of the spec it was trained on."
        )
    inputs = observations if actor.frame is None else actor.frame.inputs(observations)
    x = round_to_grid((inputs - actor.mean) * actor.scale, MAX_ACTIVATION)
    if actor.n_agents:
        index = np.broadcast_to(np.eye(n_agents), (n_copies, n_agents, n_agents))
        x = np.concatenate([x, index], axis=-1)
    x = x.reshape(n_copies * n_agents, -1)
    for weight, bias in actor.layers[:-1]:
        x = round_to_grid(np.maximum(x @ weight + bias, 0.0), MAX_ACTIVATION)
    weight, bias = actor.layers[-1]
    outputs = x @ weight + bias
    if actor.squash:
        outputs = tanh(outputs)
    means = (round_to_grid(outputs, 1.0) + 0.0).reshape(n_copies, n_agents, -1)
    return in_world(actor.frame, observations, means)


def round_to_grid(values: Double, bound: float) -> Double:
    """Returns `values` clipped to [-bound, bound] and rounded to multiples of 2^-12."""
    steps = values * STEPS_PER_UNIT
    np.rint(np.clip(steps, -bound * STEPS_PER_UNIT, bound * STEPS_PER_UNIT, out=steps), out=steps)
    steps *= 1.0 / STEPS_PER_UNIT
    return steps


def load_actor(data: bytes, n_agents: int, source: str) -> Actor:
    """Returns the actor in the bytes of a safetensors file.

    The tensors are `input.mean` and `input.scale` [O], and for each layer, from 0,
    `layers.0.weight` [in, out] and `layers.0.bias` [out]. The first layer takes O values, or O + N
    with the one-hot index of the robot. An actor with a frame also has `FRAME_TENSORS` [1], [V] and
    [C, 2], perhaps `frame.heard` [H, 3], and `frame.body` or `frame.mixed` if there are unicycles;
    O then counts the features that its frame adds.
    """
    try:
        tensors = {name: _values(array) for name, array in load(data).items()}
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{source} is not a safetensors file: {error}") from error
    named = [name for name in tensors if name in (*FRAME_TENSORS, HEARD_TENSOR)]
    body, mixed = (tensors.pop(name, None) for name in (BODY_TENSOR, MIXED_TENSOR))
    frame = _frame({name: tensors.pop(name) for name in named}, source)
    if frame is not None and mixed is not None:
        heading, *holonomic = mixed.astype(int).ravel().tolist() or [NO_HEADING]
        if heading == NO_HEADING or (n_agents and not {*holonomic} <= {*range(n_agents)}):
            raise CheckpointError(
                f"{source} has frame.mixed {mixed.tolist()}, expected the column of the heading, "
                f"then robots below {n_agents}."
            )
        frame = replace(frame, heading=heading, holonomic=tuple(holonomic))
    elif frame is not None and body is not None:
        frame = replace(frame, heading=frame.anchor)
    squash = tensors.pop(SQUASH_TENSOR, None) is not None
    n_layers = sum(name.endswith(".weight") for name in tensors)
    expected = {"input.mean", "input.scale"} | {
        f"layers.{i}.{part}" for i in range(n_layers) for part in ("weight", "bias")
    }
    if n_layers == 0 or set(tensors) != expected:
        raise CheckpointError(
            f"{source} holds tensors {sorted(tensors)}, expected input.mean, input.scale and "
            "layers.<i>.weight, layers.<i>.bias for i = 0, 1, ..."
        )
    layers = tuple(
        (tensors[f"layers.{i}.weight"], tensors[f"layers.{i}.bias"]) for i in range(n_layers)
    )
    mean, scale = tensors["input.mean"], tensors["input.scale"]
    _check_shapes(mean, scale, layers, n_agents, source)
    if frame is not None and not frame.fits(len(mean) - frame.n_added):
        raise CheckpointError(f"{source} has a frame of features that its observations lack.")
    _check_exact(layers, source)
    n_known = n_agents if len(layers[0][0]) != len(mean) else 0
    return Actor(mean, scale, layers, n_known, frame, squash)


def _frame(tensors: dict[str, Double], source: str) -> Frame | None:
    if not tensors:
        return None
    names, parts = (*FRAME_TENSORS, HEARD_TENSOR), {HEARD_TENSOR: np.empty((0, 3)), **tensors}
    shapes = {name: part.shape for name, part in parts.items()}
    if [shapes[name][1:] for name in names if name in shapes] != [(), (), (2,), (3,)]:
        raise CheckpointError(
            f"{source} has frame tensors {shapes}, expected frame.anchor [1], frame.vectors [V], "
            "frame.closing [C, 2] and, if it receives messages, frame.heard [H, 3]."
        )
    anchor, vectors, closing, heard = (parts[name].astype(int).tolist() for name in names)
    return Frame(anchor[0], tuple(vectors), tuple(map(tuple, closing)), tuple(map(tuple, heard)))


def _check_shapes(
    mean: Double, scale: Double, layers: tuple[Layer, ...], n_agents: int, source: str
) -> None:
    shapes = f"mean {mean.shape}, scale {scale.shape}, " + ", ".join(
        f"weight {weight.shape} bias {bias.shape}" for weight, bias in layers
    )
    if (
        mean.ndim != 1
        or scale.shape != mean.shape
        or any(weight.ndim != 2 or weight.size == 0 for weight, _ in layers)
    ):
        raise CheckpointError(f"{source} has malformed tensors: {shapes}.")
    if not (np.isfinite(mean).all() and np.isfinite(scale).all()):
        raise CheckpointError(f"{source} has an input mean or scale that is not finite.")
    inputs = [len(weight) for weight, _ in layers]
    outputs = [weight.shape[1] for weight, _ in layers]
    if inputs[0] not in (len(mean), len(mean) + n_agents):
        raise CheckpointError(
            f"{source}: the first layer takes {inputs[0]} values, expected O = {len(mean)}, or "
            f"O + N = {len(mean) + n_agents} with a one-hot robot index."
        )
    chained = outputs[:-1] == inputs[1:] and outputs[-1] >= 2  # a command, then a message
    if not chained or any(bias.shape != (n,) for (_, bias), n in zip(layers, outputs, strict=True)):
        raise CheckpointError(
            f"{source}: layers do not fit together, or do not end in 2 or more: {shapes}."
        )


def _check_exact(layers: Sequence[Layer], source: str) -> None:
    """Refuses networks that the proof at the top of this module does not cover."""
    for i, (weight, bias) in enumerate(layers):
        if len(weight) > MAX_WIDTH:
            raise CheckpointError(
                f"{source}: layer {i} sums {len(weight)} products, at most {MAX_WIDTH} are exact."
            )
        for array in (weight, bias):
            largest = float(np.abs(array).max())
            if not largest <= MAX_WEIGHT:  # NaN fails too
                raise CheckpointError(
                    f"{source}: layer {i} has a weight or bias of {largest:g}, expected at most "
                    f"{MAX_WEIGHT:g}. Train with weight decay or normalise the inputs."
                )
            if not np.array_equal(array * STEPS_PER_UNIT, np.round(array * STEPS_PER_UNIT)):
                raise CheckpointError(
                    f"{source}: layer {i} is not on the grid of 2^-12. Write it with save_actor."
                )


def save_actor(
    path: Path,
    layers: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]],
    mean: NDArray[np.floating],
    scale: NDArray[np.floating],
    n_agents: int = 0,
    frame: Frame | None = None,
    *,
    squash: bool = False,
) -> None:
    """Rounds a network to the grid of 2^-12, by at most 2^-13, and writes it as a checkpoint.

    Args:
        path: the file to write; an existing file is replaced.
        layers: weight [in, out] and bias [out] of each layer, in order; ReLU between them.
        mean: subtracted from observations, [O].
        scale: by which they are then multiplied, [O].
        n_agents: N if the first layer takes a one-hot robot index after the observation, else 0.
        frame: in which the network observes and acts; None for the world's.
        squash: whether the outputs pass through tanh.

    Raises:
        CheckpointError: the network cannot be run exactly, for example because |weight| > 8.
    """
    exact = [(_snap(weight), _snap(bias)) for weight, bias in layers]
    tensors: dict[str, NDArray[Any]] = {
        name: np.ascontiguousarray(values, dtype=np.float32)
        for name, values in (("input.mean", mean), ("input.scale", scale))
    }
    for i, layer in enumerate(exact):
        for part, values in zip(("weight", "bias"), layer, strict=True):
            steps = np.ascontiguousarray(values * STEPS_PER_UNIT, dtype=np.int16)
            tensors[f"layers.{i}.{part}"] = steps
    if frame is not None:
        indices = ([frame.anchor], frame.vectors, frame.closing)
        tensors |= {k: np.array(v, np.int32) for k, v in zip(FRAME_TENSORS, indices, strict=True)}
        tensors[FRAME_TENSORS[2]] = tensors[FRAME_TENSORS[2]].reshape(-1, 2)
        if frame.heard:
            tensors[HEARD_TENSOR] = np.array(frame.heard, np.int32)
        if frame.holonomic:
            tensors[MIXED_TENSOR] = np.array([frame.heading, *frame.holonomic], np.int32)
        elif frame.heading != NO_HEADING:
            tensors[BODY_TENSOR] = np.ones(1, np.int32)
    if squash:
        tensors[SQUASH_TENSOR] = np.ones(1, np.int32)
    _check_exact(exact, str(path))
    data = save(tensors)
    load_actor(data, n_agents, str(path))
    write_file(path, data)


def _snap(values: NDArray[np.floating]) -> Double:
    return np.round(values.astype(np.float64) * STEPS_PER_UNIT) / STEPS_PER_UNIT


def _values(array: NDArray[Any]) -> Double:
    """Returns a tensor's values; weights and biases are stored as grid steps, which fit 16 bits."""
    is_in_steps = array.dtype == np.int16
    return array.astype(np.float64) * (1 / STEPS_PER_UNIT if is_in_steps else 1.0)
