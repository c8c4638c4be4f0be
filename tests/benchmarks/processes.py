"""How many times the steps of one process two processes make, and what the machine allows."""

import multiprocessing
from multiprocessing.synchronize import Barrier
from typing import Any

from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks.engines import Run, swarm, timed

N_COPIES = 64


def _count(_: int) -> None:
    """Work that needs a core and nothing else."""
    for _number in range(1000):
        pass


def _work(
    spec: TaskSpec, index: int, seconds: float, rounds: int, start: Barrier, results: Any
) -> None:
    """The first process runs in every turn, the second in every other."""
    runs: tuple[Run, Run] = swarm(spec, N_COPIES), timed(_count, 1)
    runs[0](seconds)
    for turn in range(4 * rounds):
        start.wait()
        rate = runs[turn % 4 // 2](seconds) if index == 0 or turn % 2 else 0.0
        start.wait()
        results.put((turn, rate))


def measure_processes(
    spec: TaskSpec, rounds: int = 7, seconds: float = 0.4
) -> tuple[list[float], list[float]]:
    """Steps of two processes per steps of one in each round, and the same of loops that count.

    Both processes stay alive and take turns: one alone, then both. The loops show how much of two
    cores the machine gives. The caller must not be pinned to a core.
    """
    context = multiprocessing.get_context("spawn")
    start, results, n_turns = context.Barrier(2), context.SimpleQueue(), 4 * rounds
    workers = [
        context.Process(target=_work, args=(spec, index, seconds, rounds, start, results))
        for index in range(2)
    ]
    for worker in workers:
        worker.start()
    totals = [0.0] * n_turns
    for _ in range(2 * n_turns):
        turn, rate = results.get()
        totals[turn] += rate
    for worker in workers:
        worker.join()
    ratios = [both / one for one, both in zip(totals[::2], totals[1::2], strict=True)]
    return ratios[::2], ratios[1::2]
