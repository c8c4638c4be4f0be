"""What would it gain to give Munk2D only the robots that may touch something? An experiment.

    python -m tests.benchmarks.bench_islands STATES.npz [REFERENCE.npz]

Prints the time of a robot's step with random actions, and writes the states of 150 steps. Run it in
this revision and in the one before; the second time with the first file as the reference, from which
it counts the episodes that differ in a bit.
"""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from swarmdata.registry.components import make_env
from tests.benchmarks.bench_worlds import team
from tests.benchmarks.engines import swarm
from tests.benchmarks.measuring import use_last_core

SIZES, N_COPIES, N_STEPS = (4, 16, 64), 64, 150


def states_of(n_agents: int) -> np.ndarray:
    """States of all copies, [T, E, S]."""
    spec = team(n_agents)
    env = make_env(spec, N_COPIES)
    env.reset(np.arange(N_COPIES, dtype=np.uint64))
    shape = (64, N_COPIES, n_agents, env.action_size)
    actions = np.random.default_rng(0).uniform(-1, 1, shape)
    return np.array([env.step(actions[k % 64]).states.copy() for k in range(N_STEPS)])


def main(target: str, reference: str | None = None) -> None:
    use_last_core()
    states = {str(n): states_of(n) for n in SIZES}
    np.savez(target, **states)
    for n in SIZES:
        run = swarm(team(n), N_COPIES)
        rates = sorted(1e9 / (run(1.0) * n) for _ in range(7))
        print(f"{n} robots: {rates[3]:.0f} ns a robot-step ({rates[0]:.0f} to {rates[-1]:.0f})")
        if reference:
            differs = (states[str(n)] != np.load(reference)[str(n)]).any(axis=(0, 2))
            print(f"    {100 * differs.mean():.0f} % of the episodes differ")


main(*sys.argv[1:])
