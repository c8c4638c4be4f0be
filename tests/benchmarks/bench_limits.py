"""Our rates over peers' and over the physical limit, in pairs, into docs/benchmarks.md.

    python -m tests.benchmarks.bench_limits [ROW ...]

Rows: random acted physics one threads transitions windows load. Everything runs on one core, in
turns, and counts processor time, so that it can be measured beside other work. Peers that are not
installed are left out: vmas, mpe2, torchrl, flashbax. `bench_training` measures MAPPO.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from swarmdata.datasets.dataset import Dataset
from swarmdata.testing.synthetic import make_large_dataset
from tests.benchmarks import batch_peers
from tests.benchmarks.bench_load import in_fresh_process
from tests.benchmarks.bench_worlds import (
    ALL_CORES,
    best_vmas,
    preset_of,
    record_teams,
    team,
)
from tests.benchmarks.busy_thread import measure_evaluation, measure_threads
from tests.benchmarks.engines import Run, mpe2, physics, swarm
from tests.benchmarks.load_formats import FORMATS, OURS
from tests.benchmarks.measuring import Rate, pair, table, write_section
from tests.benchmarks.replays import Replay

N_STEPS = 300_000
"""Joint steps of the dataset that batches are drawn from: 320 MB, beyond every cache."""

THREADED_COPIES = (64, 256, 1024)


class Row(NamedTuple):
    """One line of the table."""

    work: str
    against: str
    ratio: Rate
    limit: Rate | None  # our rate over the physical limit's
    goal: float

    def cells(self) -> tuple[str, ...]:
        limit = "—" if self.limit is None else str(self.limit)
        return self.work, self.against, str(self.ratio), f"{self.goal:g}", limit


def compared(work: str, goal: float, ours: Run, limit: Run, **peers: Run | None) -> Iterator[Row]:
    """A row for each peer that is installed."""
    share = None
    for name, peer in peers.items():
        if peer is not None:
            share = share or pair(ours, limit)
            yield Row(work, name.replace("_", " "), pair(ours, peer), share, goal)


@cache
def vmas_of(n_agents: int) -> Run | None:
    """VMAS with collisions at its best batch, None if it is not installed."""
    found = best_vmas(n_agents, 0)
    return None if found is None else found[1]


def random_rows() -> Iterator[Row]:
    """Steps with random actions against VMAS."""
    for n, goal in ((4, 0.7), (8, 1.0), (16, 1.3)):
        work = f"steps, {n} robots, 64 copies, random actions"
        spec = team(n)
        yield from compared(work, goal, swarm(spec, 64), physics(spec, 64), VMAS=vmas_of(n))


def acted_rows() -> Iterator[Row]:
    """Steps with the actions of experts, where there are any, or of scripts."""
    for n, actor, goal in ((4, "expert", 1.2), (8, "expert", 1.8), (16, "scripted", 2.5)):
        work = f"steps, {n} robots, 64 copies, {actor} actions"
        spec = team(n)
        recording = record_teams(preset_of(n), spec, (actor,))[actor]
        ours = Replay(spec, recording)
        yield from compared(work, goal, ours, physics(spec, 64), VMAS=vmas_of(n))


def physics_rows() -> Iterator[Row]:
    """Steps over those of the physics alone."""
    spec = team(4)
    share = pair(swarm(spec, 64), physics(spec, 64))
    yield Row("steps, 4 robots, 64 copies, random actions", "physics alone", share, share, 0.7)


def one_rows() -> Iterator[Row]:
    """One copy against MPE2."""
    spec = team(4)
    yield from compared(
        "steps, 4 robots, 1 copy", 60, swarm(spec, 1), physics(spec, 1), MPE2=mpe2(4)
    )


def thread_rows() -> Iterator[Row]:
    """Two threads of one environment, and in evaluations: processor time of the busier one."""
    for n_copies in THREADED_COPIES:
        ratio = measure_threads(team(4), n_copies)
        yield Row(f"steps, 4 robots, {n_copies} copies, 2 threads", "1 thread", ratio, None, 1.9)
    for name in ("scripted", "expert"):
        ratio = measure_evaluation(name, team(4), 256)
        work = f"evaluation of `{name}`, 256 copies, 2 threads"
        yield Row(work, "1 thread", ratio, None, 1.9)


def batch_rows(dataset: Dataset, batch_size: int, length: int | None) -> Iterator[Row]:
    """Batches against the buffers of others."""
    arguments = dataset, batch_size, length
    ours, limit = batch_peers.ours(*arguments), batch_peers.copy(*arguments)
    TorchRL = batch_peers.torchrl(*arguments)
    if length is None:
        work, fancy = f"transitions, batch {batch_size}", batch_peers.fancy(dataset, batch_size)
        yield from compared(work, 8, ours, limit, TorchRL=TorchRL)
        yield from compared(work, 3, ours, limit, fancy_indexing=fancy)
    else:
        work = f"windows, {batch_size} x {length}"
        flashbax = batch_peers.flashbax(dataset, batch_size, length)
        yield from compared(work, 4, ours, limit, flashbax=flashbax, SliceSampler=TorchRL)


def with_dataset(batch_size: int, length: int | None) -> Callable[[], Iterator[Row]]:
    """The rows of a kind of batches, of a dataset that is made for them."""

    def rows() -> Iterator[Row]:
        with tempfile.TemporaryDirectory() as folder:
            make_large_dataset(Path(folder) / OURS, N_STEPS)
            yield from batch_rows(Dataset.open(Path(folder) / OURS), batch_size, length)

    return rows


def load_rows() -> Iterator[Row]:
    """Seconds of opening without checks in a fresh process, over the goal of 5 ms."""
    name, rates = "swarmdata, verify='none'", []
    with tempfile.TemporaryDirectory() as folder:
        make_large_dataset(Path(folder) / OURS, N_STEPS)
        for _ in range(9):
            found = in_fresh_process(name, Path(folder) / FORMATS[name].file)
            rates.append(1e3 * found["processor"])
    yield Row("load, unverified, fresh process", "milliseconds", Rate.of(rates), None, 5)


ROWS: dict[str, Callable[[], Iterator[Row]]] = {
    "random": random_rows,
    "acted": acted_rows,
    "physics": physics_rows,
    "one": one_rows,
    "threads": thread_rows,
    "transitions": with_dataset(256, None),
    "windows": with_dataset(64, 20),
    "load": load_rows,
}

INTRO = (
    "Our rate over that of another, on one core: the median of the ratios of 9 pairs of "
    "neighbouring turns, with the smallest and the largest in brackets. Rates count processor "
    "time. The limit is, of steps, Munk2D stepping the same worlds with random actions in a "
    "compiled loop, without skipping free motion; of batches, a contiguous copy of as many bytes. "
    "Threads: the processor time of one thread over that of the busier of two."
)


REASONS = """What keeps these from their goals, by profiles of 4 robots on a busy machine.

- Steps with random actions, 64 copies: about 70 % are physics and contacts, 19 % observations, 8 %
  scores. Calling kernels takes 7 us of some 200, so fewer kernels would gain 3 %.
- One copy: of 11 us a step, 7 us called five kernels, whose 65 arguments are unpacked one by one,
  and made the arrays of the step. The physics takes 2 us. Since then 27 of the arguments, those
  that last, reach kernels packed (`runtime.argument_blocks`).
- Threads: the caller divides the arrays and begins the step for all blocks, and the threads hand
  over the interpreter's lock at every kernel: about 25 us, and 13 us in which they meet. Against
  two processes with half of the copies each, in turns on two cores with a load of 20, two threads
  made 0.62 (0.55 to 0.74) times the steps with 256 copies and 0.91
  (0.86 to 0.97) times with 1,024: a thread that has to wait for its core holds up the other.
- Threads in an evaluation: half of its time is acting and a tenth is stepping. In one run of
  `bench_limits threads` two threads gave 1.74 (1.58 to 1.82) times the steps of 256 copies, and
  evaluations were 1.02 (0.86 to 1.2) times as fast with the scripted team, 1.28 (1.21 to 1.44)
  times with an expert. Several processes (`evaluate --workers`) share out policies instead.
- Batches: rows of observations come from memory at random, at 8 GB/s on this machine. Those of 256
  transitions take 52 of 99 us, so that 3 times fancy indexing would leave 5 us for all else. Of
  windows, a compiled loop that reads each row once for observations and next observations would
  save about a quarter, but needs numba in every process that samples.
- `load`: took 11.3 ms where it now takes 7.5 (medians of 12 pairs, a dataset of 1 GB); the rest is
  spread over reading and checking 27 small files."""


def main() -> None:
    """Measures the rows named on the command line, all by default, on the last core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(ALL_CORES)})
    names = sys.argv[1:] or list(ROWS)
    rows = []
    for name in names:
        for row in ROWS[name]():
            rows.append(row.cells())
            print(" | ".join(rows[-1]), flush=True)
    if names == list(ROWS):
        head = ("work", "against", "ours / it", "goal", "ours / limit")
        write_section("Near the limit", f"{INTRO}\n\n{table(head, rows)}\n{REASONS}")


if __name__ == "__main__":
    main()
