"""Our rates over peers' and over the physical limit, in pairs, into docs/measurements.md.

    python -m tests.benchmarks.bench_limits [ROW ...]

Rows: random acted one transitions windows. Peers that are not installed are left out: vmas, mpe2,
torchrl, flashbax. Their buffers hold the fields of our batches but `log_probs` and `next_actions`.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from tests.benchmarks.bench_worlds import best_vmas, preset_of, record_teams, team
from tests.benchmarks.engines import Run, mpe2, physics, swarm, timed
from tests.benchmarks.large_dataset import make_large_dataset
from tests.benchmarks.load_formats import OURS
from tests.benchmarks.measuring import Rate, pair, table, use_last_core, write_section
from tests.benchmarks.replays import Replay

N_STEPS = 300_000
"""Joint steps of the dataset that batches are drawn from: 320 MB, beyond every cache."""


class Row(NamedTuple):
    work: str
    against: str
    ratio: Rate
    limit: Rate  # our rate over the physical limit's

    def cells(self) -> tuple[str, ...]:
        return self.work, self.against, str(self.ratio), str(self.limit)


def compared(work: str, ours: Run, limit: Run, **peers: Run | None) -> Iterator[Row]:
    """A row for each peer that is installed."""
    share = None
    for name, peer in peers.items():
        if peer is not None:
            share = share or pair(ours, limit)
            yield Row(work, name.replace("_", " "), pair(ours, peer), share)


@cache
def vmas_of(n_agents: int) -> Run | None:
    """VMAS with collisions at its best batch, None if it is not installed."""
    found = best_vmas(n_agents, 0)
    return None if found is None else found[1]


def random_rows() -> Iterator[Row]:
    for n in (4, 8, 16):
        work = f"steps, {n} robots, 64 copies, random actions"
        spec = team(n)
        yield from compared(work, swarm(spec, 64), physics(spec, 64), VMAS=vmas_of(n))


def acted_rows() -> Iterator[Row]:
    """Steps with the actions of experts, where there are any, or of scripts."""
    for n, actor in ((4, "expert"), (8, "expert"), (16, "scripted")):
        work = f"steps, {n} robots, 64 copies, {actor} actions"
        spec = team(n)
        recording = record_teams(preset_of(n), spec, (actor,))[actor]
        ours = Replay(spec, recording)
        yield from compared(work, ours, physics(spec, 64), VMAS=vmas_of(n))


def one_rows() -> Iterator[Row]:
    spec = team(4)
    yield from compared("steps, 4 robots, 1 copy", swarm(spec, 1), physics(spec, 1), MPE2=mpe2(4))


STATE_NAMES = ("observations", "states")
STEP_NAMES = ("actions", "rewards", "terminations", "truncations")


def ours_batches(dataset: Dataset, batch_size: int, length: int | None) -> Run:
    """Transitions, or windows of `length` steps."""
    sampler = dataset.sampler(batch_size, horizon=length)
    return timed(lambda _: next(sampler), batch_size * (length or 1))


def copy_batches(dataset: Dataset, batch_size: int, length: int | None) -> Run:
    """The limit: a contiguous copy of as many bytes, from the cache."""
    batch = next(dataset.sampler(batch_size, horizon=length))
    values = (getattr(batch, field.name) for field in fields(batch))
    size = sum(each.nbytes for each in values if each is not None)
    source, target = np.ones(size, np.uint8), np.empty(size, np.uint8)
    return timed(lambda _: np.copyto(target, source), batch_size * (length or 1))


def fancy_batches(dataset: Dataset, batch_size: int) -> Run:
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


def torchrl_batches(dataset: Dataset, batch_size: int, length: int | None) -> Run | None:
    """TorchRL's buffer in memory, with its `SliceSampler` for windows; None if not installed."""
    if find_spec("torchrl") is None:
        return None
    import torch

    torch.set_num_threads(1)
    n_steps = batch_size * (length or 1)
    buffer = dataset.replay_buffer(n_steps, slice_length=length)
    return timed(lambda _: buffer.sample(), n_steps)


def flashbax_batches(dataset: Dataset, batch_size: int, length: int) -> Run | None:
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


def batch_rows(dataset: Dataset, batch_size: int, length: int | None) -> Iterator[Row]:
    arguments = dataset, batch_size, length
    ours, limit = ours_batches(*arguments), copy_batches(*arguments)
    TorchRL = torchrl_batches(*arguments)
    if length is None:
        work, fancy = f"transitions, batch {batch_size}", fancy_batches(dataset, batch_size)
        yield from compared(work, ours, limit, TorchRL=TorchRL)
        yield from compared(work, ours, limit, fancy_indexing=fancy)
    else:
        work = f"windows, {batch_size} x {length}"
        flashbax = flashbax_batches(dataset, batch_size, length)
        yield from compared(work, ours, limit, flashbax=flashbax, SliceSampler=TorchRL)


def with_dataset(batch_size: int, length: int | None) -> Callable[[], Iterator[Row]]:
    """The rows of a kind of batches, of a dataset that is made for them."""

    def rows() -> Iterator[Row]:
        with tempfile.TemporaryDirectory() as folder:
            make_large_dataset(Path(folder) / OURS, N_STEPS)
            yield from batch_rows(Dataset.open(Path(folder) / OURS), batch_size, length)

    return rows


ROWS: dict[str, Callable[[], Iterator[Row]]] = {
    "random": random_rows,
    "acted": acted_rows,
    "one": one_rows,
    "transitions": with_dataset(256, None),
    "windows": with_dataset(64, 20),
}

INTRO = (
    "Our rate over that of another, in processor time: the median of 9 ratios, with the smallest "
    "and the largest in brackets. The limit of steps is Munk2D stepping the same worlds with "
    "random actions in a compiled loop, without skipping free motion; the limit of batches is a "
    "contiguous copy of as many bytes."
)


def main() -> None:
    use_last_core()
    names = sys.argv[1:] or list(ROWS)
    rows = []
    for name in names:
        for row in ROWS[name]():
            rows.append(row.cells())
            print(" | ".join(rows[-1]), flush=True)
    if names == list(ROWS):
        head = ("work", "against", "ours / it", "ours / limit")
        write_section("Near the limit", f"{INTRO}\n\n{table(head, rows)}")


if __name__ == "__main__":
    main()
