"""How much faster two threads step or evaluate, by the processor time of the busier one.

A busy machine does not run both at once, so its clock says nothing. On an idle one a step takes as
long as its busier thread works, and the 13 us in which the threads meet. The busier one is the
caller's: it steps as many copies as the other, and divides the work.
"""

import time

import numpy as np

from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double
from tests.benchmarks.measuring import Rate

N_STEPS, N_ACTIONS = 40, 8


def measure_threads(spec: TaskSpec, n_copies: int, rounds: int = 9) -> Rate:
    """Processor time of one thread over that of the busier of two, in pairs, on the same steps."""
    envs = [make_env(spec, n_copies, n_threads=n) for n in (1, 2)]
    shape = (N_ACTIONS, n_copies, spec.n_agents, envs[0].action_size)
    actions = np.random.default_rng(0).uniform(-1, 1, shape)
    ratios = []
    for turn in range(rounds + 1):
        seeds = np.arange(turn * n_copies, (turn + 1) * n_copies, dtype=np.uint64)
        for env in envs:
            env.reset(seeds)
        used = [0.0, 0.0]
        for k in range(N_STEPS):
            for i in (0, 1):
                used[i] += _step(envs[i], actions[k % N_ACTIONS])
        ratios.append(used[0] / used[1])
    for env in envs:
        env.close()
    return Rate.of(ratios[1:])  # the first warms the caches


def measure_evaluation(name: str, spec: TaskSpec, n_copies: int, rounds: int = 5) -> Rate:
    """The same of a whole evaluation by a policy that is shipped: acting, stepping, measuring."""
    policy, n_episodes = find_target(name, spec.task).policies[0], 2 * n_copies

    def seconds(n_threads: int) -> float:
        begin = time.thread_time()
        evaluate(
            policy, spec, name=name, n_episodes=n_episodes, n_copies=n_copies, n_threads=n_threads,
            progress=False,
        )  # fmt: skip
        return time.thread_time() - begin

    seconds(2)  # warms the caches
    return Rate.of([seconds(1) / seconds(2) for _ in range(rounds)])


def _step(env: VecEnv, actions: Double) -> float:
    """Seconds that this thread works."""
    begin = time.thread_time()
    env.step(actions)
    return time.thread_time() - begin
