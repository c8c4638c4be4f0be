"""How much faster two processes are than one."""

import multiprocessing
from multiprocessing.synchronize import Barrier
from typing import Any

from swarmdata.spec import TaskSpec
from tests.benchmarks.engines import swarm


def _work(spec: TaskSpec, seconds: float, rounds: int, start: Barrier, results: Any) -> None:
    run = swarm(spec, 64)
    run(0.5)
    for _ in range(rounds):
        start.wait()
        results.put(run(seconds))


def _rates(spec: TaskSpec, n_processes: int, seconds: float, rounds: int) -> list[float]:
    """Steps a second of all processes together, in each round."""
    context = multiprocessing.get_context("spawn")
    start, results = context.Barrier(n_processes), context.SimpleQueue()
    workers = [
        context.Process(target=_work, args=(spec, seconds, rounds, start, results))
        for _ in range(n_processes)
    ]
    for worker in workers:
        worker.start()
    rates = [sum(results.get() for _ in range(n_processes)) for _ in range(rounds)]
    for worker in workers:
        worker.join()
    return rates


def measure_processes(spec: TaskSpec, rounds: int = 5, seconds: float = 0.5) -> list[float]:
    """Steps of two processes per steps of one, in each of so many rounds."""
    return []
