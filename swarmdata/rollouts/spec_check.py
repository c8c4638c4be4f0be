"""Checks that the world that a spec describes can be built, drawn and simulated."""

from collections.abc import Iterator

import numpy as np

from swarmdata.errors import SpawnError, SpecError
from swarmdata.interfaces import VecEnv
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec

N_LAYOUTS = 8  # evaluation episodes that are begun
N_STEPS = 20  # control steps with random actions in the last of these episodes


def probe(spec: TaskSpec) -> VecEnv:
    """Builds a copy of the world, begins episodes, and takes random steps; returns the copy."""
    env = make_env(spec)
    problems = list(_problems(env))
    if problems:
        raise SpecError(f"the spec of {spec.task} cannot be used: {'; '.join(problems)}")
    return env


def _problems(env: VecEnv) -> Iterator[str]:
    failures, step = [], None
    for seed in evaluation_seeds(N_LAYOUTS):
        try:
            step = env.reset(np.array([seed], np.uint64))
        except SpawnError as error:
            failures.append(str(error))
    if failures:
        yield f"{len(failures)} of {N_LAYOUTS} layouts could not be drawn, the first: {failures[0]}"
    if step is None:
        return
    numbers = np.random.default_rng(0)
    for _ in range(min(N_STEPS, env.spec.horizon)):
        shape = (1, env.spec.n_agents, env.action_size)
        step = env.step(numbers.uniform(-1, 1, shape).astype(np.float32))
    for name in ("states", "observations", "rewards", "sent"):
        if not np.isfinite(getattr(step, name)).all():
            yield f"{name} have values that are not finite, expected finite numbers"
