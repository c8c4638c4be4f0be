"""Samplers of batches on the arrays of one dataset: ours, peers', and a copy of the same bytes.

Each is a `Run` that returns joint steps sampled per second of processor time. Peers hold the fields
of our batches but the logarithms of probabilities and the next actions.
"""

from collections.abc import Callable
from dataclasses import fields
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.types import Batch
from tests.benchmarks.engines import Run, timed

STATE_NAMES, STEP_NAMES = (
    ("observations", "states"),
    ("actions", "rewards", "terminations", "truncations"),
)


def n_bytes(batch: Batch) -> int:
    """Of all fields."""
    values = (getattr(batch, field.name) for field in fields(batch))
    return sum(each.nbytes for each in values if each is not None)


def ours(dataset: Dataset, batch_size: int, length: int | None) -> Run:
    """Transitions, or windows of `length` steps."""
    sampler = dataset.sampler(batch_size, horizon=length)
    return timed(lambda _: next(sampler), batch_size * (length or 1))


def copy(dataset: Dataset, batch_size: int, length: int | None) -> Run:
    """The limit: a contiguous copy of as many bytes, from the cache."""
    size = n_bytes(next(dataset.sampler(batch_size, horizon=length)))
    source, target = np.ones(size, np.uint8), np.empty(size, np.uint8)
    return timed(lambda _: np.copyto(target, source), batch_size * (length or 1))


def fancy(dataset: Dataset, batch_size: int) -> Run:
    """What users write: fancy indexing of every field, with a NumPy generator."""
    arrays = dataset.stored.arrays
    rng = np.random.default_rng(0)
    episode = np.repeat(np.arange(len(dataset)), dataset.episodes.lengths)

    def draw(_: int) -> list[NDArray[Any]]:
        index = rng.integers(0, dataset.n_steps, batch_size)
        here = index + episode[index]
        found = [arrays[name][here + k] for name in STATE_NAMES for k in (0, 1)]
        return found + [arrays[name][index] for name in STEP_NAMES]

    return timed(draw, batch_size)


def torchrl(dataset: Dataset, batch_size: int, length: int | None) -> Run | None:
    """TorchRL's buffer in memory, with its `SliceSampler` for windows; None if not installed."""
    if find_spec("torchrl") is None:
        return None
    import torch

    torch.set_num_threads(1)
    n_steps = batch_size * (length or 1)
    buffer = dataset.replay_buffer(n_steps, slice_length=length)
    return timed(lambda _: buffer.sample(), n_steps)


def flashbax(dataset: Dataset, batch_size: int, length: int) -> Run | None:
    """Its trajectory buffer, compiled by JAX for the CPU; None if not installed."""
    if find_spec("flashbax") is None:
        return None
    jax: Any = import_module("jax")
    arrays, rows = dataset.stored.arrays, dataset.sampler(1).rows.valid
    episode = np.repeat(np.arange(len(dataset)), dataset.episodes.lengths)
    stored = {name: arrays[name].take(rows + episode, axis=0) for name in STATE_NAMES}
    stored |= {name: arrays[name].take(rows, axis=0) for name in STEP_NAMES}
    make: Callable[..., Any] = import_module("flashbax").make_trajectory_buffer
    buffer = make(
        max_length_time_axis=len(rows) + 1, min_length_time_axis=length, add_batch_size=1,
        sample_batch_size=batch_size, sample_sequence_length=length, period=1,
    )  # fmt: skip
    state = buffer.init({name: values[0] for name, values in stored.items()})
    state = buffer.add(state, {name: values[None] for name, values in stored.items()})
    sample, key = jax.jit(buffer.sample), jax.random.PRNGKey(0)

    def draw(k: int) -> None:
        jax.block_until_ready(sample(state, jax.random.fold_in(key, k)))

    return timed(draw, batch_size * length)
