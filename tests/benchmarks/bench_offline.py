"""Seed-updates a second of offline training, into docs/benchmarks.md.

    python -m tests.benchmarks.bench_offline [--og-marl CHECKOUT] [--eager] [--device cuda]

All runs of a table learn from the same dataset in one process on one core, in turns, and are timed
by processor time, which the load of others changes less than the clock. A seed-update is one
update of one seed; five sequential runs make as many in a second as one of them.
OG-MARL is measured from a checkout of instadeepai/og-marl (f4eb8f0 is what was measured).
"""

import argparse
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from swarmdata import load
from swarmdata.learn.networks.compilation import compiling, uncompiled
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.learn.training.setup import Setup
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig
from swarmdata.runtime.freed_memory import keep_freed_memory
from swarmdata.types import Batch
from tests.benchmarks.measuring import Rate, table, write_section
from tests.benchmarks.og_marl import SYSTEMS, og_marl
from tests.benchmarks.plain_td3_bc import PlainTD3BC

DATASET, HIDDEN, N_SEEDS, ROUNDS = "coop_nav-medium-mini", (64, 128), 5, 5

INTRODUCTION = f"""\
`maddpg_bc` on `{DATASET}` (4 robots, batches of 256 joint transitions), without evaluation and
files, on one core: seed-updates per second of processor time. Five sequential runs have the rate
of one. The plain loop is TD3+BC written as in single-file implementations, with networks of the
same width and batches of the same size (`tests/benchmarks/plain_td3_bc.py`). Its critics give one
value of the team, those of `maddpg_bc` one for each robot: four times as many rows. OG-MARL's torch
systems run from its source with the defaults of their constructors: a GRU of 64 units over windows
of 20 steps, batches of 32 windows.
"""

Update = Callable[[], object]

PLAIN, ONE, STACK = "plain loop, 1 seed", "ours, 1 seed", f"ours, {N_SEEDS} seeds stacked"
ONE_COMPILED, STACK_COMPILED = f"{ONE}, compiled", f"{STACK}, compiled"


def everything(data: Any) -> tuple[Batch, Statistics]:
    """All transitions in order, with normalized observations and states, and the statistics."""
    sampler = data.sampler(256, seed=0)
    statistics = Statistics.measure(data, 0.95)
    batch = sampler.gather(np.sort(sampler.rows.valid)).to_torch()
    known = Normalizer(statistics, "cpu")
    return replace(
        batch,
        observations=known.observations(batch.observations),
        next_observations=known.observations(batch.next_observations),
        states=known.states(batch.states),
        next_states=known.states(batch.next_states),
        rewards=batch.rewards / statistics.return_std,
    ), statistics


def ours(data: Any, statistics: Statistics, hidden: int, n_seeds: int, device: str) -> Update:
    """`maddpg_bc` as the trainer runs it: draw, gather, update."""
    samplers = [data.sampler(256, seed=seed) for seed in range(n_seeds)]
    sizes = Sizes.of(samplers[0].gather(np.zeros(1, dtype=np.int64)))
    config = MADDPGBCConfig(
        actor_hidden=(hidden, hidden), critic_hidden=(hidden, hidden), bc_warmup_updates=0
    )
    algorithm = MADDPGBC(Setup(sizes, range(n_seeds), statistics, device), config)

    def update() -> object:
        index = np.stack([sampler.draw() for sampler in samplers])
        return algorithm.update(samplers[0].gather(index).to_torch(device))

    return update


def compiled(update: Update) -> Update:
    """The same with kernels, which are made here; says what that took."""
    with compiling() as compilation:
        begin = time.perf_counter()
        update(), update()
        print(f"  {compilation}; first two updates {time.perf_counter() - begin:.0f} s", flush=True)
    return update


def measure(
    runs: Mapping[str, Update],
    is_compiled: Sequence[str],
    seconds: float,
    clock: Callable[[], float],
) -> dict[str, list[float]]:
    """Updates a second of each run in each round; every other update moves the actors."""
    rates: dict[str, list[float]] = {name: [] for name in runs}
    with compiling() if is_compiled else nullcontext():
        for turn in range(ROUNDS + 1):
            for name, update in runs.items():
                with nullcontext() if name in is_compiled else uncompiled():
                    rate = _rate(update, seconds, clock)
                if turn:  # the first warms up
                    rates[name].append(rate)
    return rates


def _rate(update: Update, seconds: float, clock: Callable[[], float]) -> float:
    begin, n = clock(), 0
    while (spent := clock() - begin) < seconds or n < 2:
        update(), update()
        n += 2
    return n / spent


def rows_of(
    rates: Mapping[str, list[float]], n_seeds: Mapping[str, int], base: str
) -> list[tuple[str, ...]]:
    """Seed-updates a second and the ratio to `base` in the same round."""
    rows: list[tuple[str, ...]] = []
    for name, values in rates.items():
        scaled = [n_seeds[name] * value for value in values]
        theirs = [n_seeds[base] * value for value in rates[base]]
        ratios = [a / b for a, b in zip(scaled, theirs, strict=True)]
        rows.append((name, str(Rate.of(scaled)), str(Rate.of(ratios))))
    return rows


def networks_table(
    data: Any, whole: Batch, statistics: Statistics, hidden: int, arguments: argparse.Namespace
) -> str:
    """Measures networks of one size; OG-MARL's systems, whose sizes are fixed, beside the first."""
    runs: dict[str, Update] = {
        PLAIN: PlainTD3BC(whole, hidden).train,
        ONE: ours(data, statistics, hidden, 1, "cpu"),
        STACK: ours(data, statistics, hidden, N_SEEDS, "cpu"),
    }
    if not arguments.eager:
        runs[ONE_COMPILED] = compiled(ours(data, statistics, hidden, 1, "cpu"))
        runs[STACK_COMPILED] = compiled(ours(data, statistics, hidden, N_SEEDS, "cpu"))
    if arguments.og_marl is not None and hidden == HIDDEN[0]:
        for name in SYSTEMS:
            runs[f"OG-MARL `{name}`"] = og_marl(arguments.og_marl, name, whole)
    is_compiled = [name for name in (ONE_COMPILED, STACK_COMPILED) if name in runs]
    rates = measure(runs, is_compiled, arguments.seconds, time.process_time)
    n_seeds = {name: N_SEEDS if name in (STACK, STACK_COMPILED) else 1 for name in runs}
    rows = rows_of(rates, n_seeds, PLAIN)
    own = [row[2] for row in rows_of(rates, n_seeds, ONE)]
    head = ("run", "seed-updates a second", "/ plain loop", "/ ours, 1 seed")
    lines = [(*row, ratio) for row, ratio in zip(rows, own, strict=True)]
    return f"Two hidden layers of {hidden}:\n\n{table(head, lines)}"


def on_device(data: Any, device: str, seconds: float) -> None:
    """Prints seed-updates a second of 20 seeds against one; a GPU is timed by the clock."""
    _, statistics = everything(data)
    many = 20

    def clock() -> float:
        torch.cuda.synchronize(device)
        return time.perf_counter()

    for hidden in HIDDEN:
        runs = {f"{k} seeds": ours(data, statistics, hidden, k, device) for k in (1, many)}
        rates = measure(runs, (), seconds, clock)
        rows = rows_of(rates, {"1 seeds": 1, f"{many} seeds": many}, "1 seeds")
        print(f"hidden {hidden}\n{table(('run', 'seed-updates a second', '/ 1 seed'), rows)}")


def main() -> None:
    """Measures and writes the section."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--og-marl", type=Path, help="checkout of instadeepai/og-marl")
    parser.add_argument("--eager", action="store_true", help="without the compiled runs")
    parser.add_argument("--device", default="cpu", help="cuda measures 20 seeds against one")
    parser.add_argument("--seconds", type=float, default=0.4, help="of each turn")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    keep_freed_memory()  # as the trainer does
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    data = load(DATASET).split("train")
    if arguments.device != "cpu":
        on_device(data, arguments.device, arguments.seconds)
        return
    body = [INTRODUCTION]
    whole, statistics = everything(data)
    for hidden in HIDDEN:
        print(f"hidden {hidden}", flush=True)
        body.append(networks_table(data, whole, statistics, hidden, arguments))
    write_section("Offline training", "\n".join(body))
    print("\n".join(body))


if __name__ == "__main__":
    main()
