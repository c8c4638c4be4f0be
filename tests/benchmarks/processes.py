"""How many times the steps of one process two processes make."""

import multiprocessing
from multiprocessing.synchronize import Barrier
from typing import Any

from swarmdata.spec import TaskSpec
from tests.benchmarks.engines import swarm

N_COPIES = 64


def _work(
    spec: TaskSpec, index: int, seconds: float, turns: int, start: Barrier, results: Any
) -> None:
    """The first process runs in every turn, the second in every other."""
    run = swarm(spec, N_COPIES)
    run(seconds)
    for turn in range(turns):
        start.wait()
        rate = run(seconds) if index == 0 or turn % 2 else 0.0
        start.wait()
        results.put((turn, rate))


def measure_processes(spec: TaskSpec, rounds: int = 7, seconds: float = 0.4) -> list[float]:
    """Steps of two processes per steps of one, in each of so many rounds.

    Both stay alive, and take turns: one alone, then both. The caller must not be pinned to a core.
    """
    context = multiprocessing.get_context("spawn")
    start, results, turns = context.Barrier(2), context.SimpleQueue(), 2 * rounds
    workers = [
        context.Process(target=_work, args=(spec, index, seconds, turns, start, results))
        for index in range(2)
    ]
    for worker in workers:
        worker.start()
    totals = [0.0] * turns
    for _ in range(2 * turns):
        turn, rate = results.get()
        totals[turn] += rate
    for worker in workers:
        worker.join()
    return [both / one for one, both in zip(totals[::2], totals[1::2], strict=True)]
