"""Environment steps a second on one core against MPE2 and VMAS, interleaved in one run.

    taskset -c 0 python tests/benchmarks/bench_worlds.py

Every engine steps 4 robots under random actions, with observations, rewards and resets. VMAS is
measured if it is installed (`pip install vmas`).
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np

from swarmdata.registry import make_env
from swarmdata.spec import TaskSpec

ROUNDS, SECONDS = 8, 1.0


def ours(n_copies: int) -> Callable[[float], float]:
    env = make_env(TaskSpec(), n_copies)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (64, n_copies, 4, 2))
    state = {"next": n_copies}
    env.reset(np.arange(n_copies, dtype=np.uint64))
    env.step(actions[0])

    def run(seconds: float) -> float:
        begin, steps = time.perf_counter(), 0
        while time.perf_counter() - begin < seconds:
            step = env.step(actions[steps % 64])
            steps += 1
            ended = np.flatnonzero(step.ended)
            if len(ended):
                first = state["next"]
                state["next"] += len(ended)
                env.reset(np.arange(first, first + len(ended), dtype=np.uint64), ended)
        return n_copies * steps / (time.perf_counter() - begin)

    return run


def mpe2() -> Callable[[float], float]:
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=4, continuous_actions=True, max_cycles=25)
    rng = np.random.default_rng(0)
    env.reset(seed=0)

    def run(seconds: float) -> float:
        begin, steps = time.perf_counter(), 0
        while time.perf_counter() - begin < seconds:
            if not env.agents:
                env.reset()
            env.step({name: rng.random(5, dtype=np.float32) for name in env.agents})
            steps += 1
        return steps / (time.perf_counter() - begin)

    return run


def vmas(n_copies: int) -> Callable[[float], float]:
    import torch
    import vmas as package  # type: ignore[import-not-found]  # a peer to measure, not a dependency

    torch.set_num_threads(1)
    env = package.make_env(
        "navigation", num_envs=n_copies, device="cpu", continuous_actions=True, n_agents=4,
        collisions=True, lidar_range=0.0, n_lidar_rays=1, seed=0,
    )  # fmt: skip
    nothing = torch.zeros(n_copies, 1)
    for agent in env.agents:  # its lidar costs six times the rest; ours has none here
        agent.sensors[0].measure = lambda: nothing
    actions = [torch.rand(n_copies, 2) * 2 - 1 for _ in env.agents]
    env.reset()

    def run(seconds: float) -> float:
        begin, steps = time.perf_counter(), 0
        while time.perf_counter() - begin < seconds:
            env.step(actions)
            steps += 1
            if steps % 100 == 0:
                env.reset()
        return n_copies * steps / (time.perf_counter() - begin)

    return run


def engines() -> Iterator[tuple[str, Callable[[float], float]]]:
    yield "mpe2 simple_spread_v3", mpe2()
    for n_copies in (1, 16, 64):
        yield f"swarmdata coop_nav, {n_copies} copies", ours(n_copies)
    if find_spec("vmas"):
        yield "vmas navigation, 1024 copies", vmas(1024)


def main() -> None:
    runs = list(engines())
    rates: dict[str, list[float]] = {name: [] for name, _ in runs}
    for _ in range(ROUNDS):
        for name, run in runs:
            rates[name].append(run(SECONDS))
    base = np.median(rates["mpe2 simple_spread_v3"])
    for name, values in rates.items():
        rate = np.median(values)
        print(f"{name:32s} {rate:10,.0f} env steps/s  {rate / base:7.1f} x MPE2")


if __name__ == "__main__":
    main()
