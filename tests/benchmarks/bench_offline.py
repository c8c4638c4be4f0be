"""Seed-updates a second of offline training, into docs/measurements.md.

    python -m tests.benchmarks.bench_offline [--eager]

All runs of a table learn from the same dataset in one process on one core, in turns, and are timed
by processor time. A seed-update is one update of one seed.
"""

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from swarmdata import load
from swarmdata.interfaces import fields_of
from swarmdata.learn.networks.compilation import compiling, uncompiled
from swarmdata.learn.networks.critics import RobotViews
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import Normalizer, with_agent_id
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig
from swarmdata.runtime.native_libraries import keep_freed_memory
from tests.benchmarks.measuring import Rate, table, use_last_core, write_section
from tests.benchmarks.plain_loops import PlainBC, PlainTD3BC

DATASET, HIDDEN, N_SEEDS, ROUNDS, BATCH = "coop_nav-medium-mini", (64, 128), 5, 5, 128

INTRODUCTION = f"""\
Updates of all seeds per second of processor time: `bc` and one-stage `maddpg_bc` on `{DATASET}` (4
robots, batches of {BATCH} joint transitions), without evaluation and files. The plain loops are
written like single-file implementations, with the same networks and batches
(`tests/benchmarks/plain_loops.py`); their losses lack our scales and bounds, and they have no
schedule and compute frames in advance, which favors them. The last column is the share of the
limit: floating-point operations in matrix products per second, over the fastest rate of a product
of two 1024 x 1024 matrices in the same run. No update reaches 1, because its matrices are narrow
and it does more than multiply them.
"""

Update = Callable[[], object]

PLAIN, ONE, STACK = "plain loop, 1 seed", "ours, 1 seed", f"ours, {N_SEEDS} seeds stacked"
ONE_COMPILED, STACK_COMPILED = f"{ONE}, compiled", f"{STACK}, compiled"


def tensors_of(data: Any) -> dict[str, Tensor]:
    """What plain loops learn from: all transitions, as their networks see them."""
    sampler = data.sampler(BATCH, seed=0)
    raw = sampler.gather(np.sort(sampler.rows.valid)[None])
    sizes, batch = Sizes.of(sampler.gather(np.zeros(1, dtype=np.int64))), raw.to_torch()
    statistics = Statistics.measure(data, 0.95)
    known = Normalizer(statistics, "cpu")
    views = RobotViews(sizes, known, "centralized", "cpu")
    observations, following = (
        with_agent_id(known.observations(seen))[0]
        for seen in (batch.observations, batch.next_observations)
    )
    return {
        "observations": observations,
        "next_observations": following,
        "actions": batch.actions[0],
        "x": views.view(batch.states, batch.observations).features[0],
        "next_x": views.view(batch.next_states, batch.next_observations).features[0],
        "rewards": batch.rewards[0] * (1 / statistics.return_std),
        "terminations": batch.terminations[0].float()[:, None],
    }


def ours(name: str, data: Any, hidden: int, n_seeds: int) -> Update:
    """An algorithm as the trainer runs it: draw, gather, update."""
    samplers = [data.sampler(BATCH, seed=seed) for seed in range(n_seeds)]
    sizes = Sizes.of(samplers[0].gather(np.zeros(1, dtype=np.int64)))
    both = (hidden, hidden)
    setup = Setup(sizes, range(n_seeds), Statistics.measure(data, 0.95), "cpu")
    algorithm: BC | MADDPGBC
    if name == "bc":
        algorithm = BC(setup, BCConfig(hidden=both))
    else:
        config = MADDPGBCConfig(
            actor_hidden=both, critic_hidden=both, bc_warmup_share=0.0, extraction="joint"
        )
        algorithm = MADDPGBC(setup, config)

    wanted = fields_of(type(algorithm))

    def update() -> object:
        index = np.stack([sampler.draw() for sampler in samplers])
        return algorithm.update(samplers[0].gather(index, wanted).to_torch())

    return update


def operations(update: Update) -> float:
    """Floating-point operations of the products of one update, of two in a row."""
    with FlopCounterMode(display=False) as counter:
        update(), update()
    return counter.get_total_flops() / 2


def fastest_rate(seconds: float) -> float:
    """Floating-point operations a second of a product of square matrices, [1024, 1024]."""
    one = torch.ones(1, 1024, 1024)
    rates = [_rate(partial(torch.bmm, one, one), seconds) for _ in range(ROUNDS)]
    return max(rates) * 2 * 1024**3


def compiled(update: Update) -> Update:
    """The same with kernels, which are made here; says what that took."""
    with compiling() as compilation:
        begin = time.perf_counter()
        update(), update()
        print(f"  {compilation}; first two updates {time.perf_counter() - begin:.0f} s", flush=True)
    return update


def measure(
    runs: Mapping[str, Update], is_compiled: Sequence[str], seconds: float
) -> dict[str, list[float]]:
    """Updates a second of each run in each round; every other update moves the actors."""
    rates: dict[str, list[float]] = {name: [] for name in runs}
    with compiling() if is_compiled else nullcontext():
        for turn in range(ROUNDS + 1):
            for name, update in runs.items():
                with nullcontext() if name in is_compiled else uncompiled():
                    rate = _rate(update, seconds)
                if turn:  # the first warms up
                    rates[name].append(rate)
    return rates


def _rate(update: Update, seconds: float) -> float:
    begin, n = time.process_time(), 0
    while (spent := time.process_time() - begin) < seconds or n < 2:
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


HEAD = (
    "algorithm", "units of two layers", "million operations an update", "run",
    "seed-updates a second", "/ plain loop", "/ ours, 1 seed", "/ limit",
)  # fmt: skip


def networks_rows(
    name: str, data: Any, hidden: int, arguments: argparse.Namespace
) -> list[tuple[str, ...]]:
    plain = (PlainBC if name == "bc" else PlainTD3BC)(tensors_of(data), hidden, BATCH)
    work = operations(plain.train)
    runs: dict[str, Update] = {
        PLAIN: plain.train,
        ONE: ours(name, data, hidden, 1),
        STACK: ours(name, data, hidden, N_SEEDS),
    }
    if not arguments.eager:
        runs[ONE_COMPILED] = compiled(ours(name, data, hidden, 1))
        runs[STACK_COMPILED] = compiled(ours(name, data, hidden, N_SEEDS))
    is_compiled = [run for run in (ONE_COMPILED, STACK_COMPILED) if run in runs]
    limit = fastest_rate(arguments.seconds) / work
    rates = measure(runs, is_compiled, arguments.seconds)
    n_seeds = {run: N_SEEDS if run in (STACK, STACK_COMPILED) else 1 for run in runs}
    rows = rows_of(rates, n_seeds, PLAIN)
    own = [row[2] for row in rows_of(rates, n_seeds, ONE)]
    shares = [f"{np.median(rates[run]) * n_seeds[run] / limit:.2f}" for run in runs]
    size = (f"`{name}`", str(hidden), f"{work / 1e6:.0f}")
    return [(*size, *row, *rest) for row, *rest in zip(rows, own, shares, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--eager", action="store_true", help="without the compiled runs")
    parser.add_argument("--seconds", type=float, default=0.4, help="of each turn")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    keep_freed_memory()  # as the trainer does
    use_last_core()
    data = load(DATASET).split("train")
    rows: list[tuple[str, ...]] = []
    for name in ("bc", "maddpg_bc"):
        for hidden in HIDDEN:
            print(f"{name}, hidden {hidden}", flush=True)
            rows += networks_rows(name, data, hidden, arguments)
    body = table(HEAD, rows)
    write_section("Offline training", f"{INTRODUCTION}\n{body}")
    print(body)


if __name__ == "__main__":
    main()
