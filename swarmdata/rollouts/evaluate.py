"""Evaluates a policy on seeds that no dataset has; `result_files` stores the result."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from tqdm import tqdm

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy
from swarmdata.numerics.random import SeedBlock, block_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.metrics import episode_metrics, metrics_of
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult, Seeds


def evaluate(
    policy: Policy,
    spec: TaskSpec | Path | str,
    *,
    name: str = "policy",
    n_episodes: int = 1000,
    block: SeedBlock = "evaluation",
    seeds: Seeds | None = None,
    n_copies: int = 64,
    n_threads: int = 1,
    policy_threads: int = 1,
    progress: bool = True,
    report: Callable[[int], object] = lambda episodes: None,
) -> EvalResult:
    """Runs a policy on the first `n_episodes` seeds of a block, the same for everybody.

    Episodes are measured as they finish, and are not kept. The result does not depend on
    `n_copies` and the numbers of threads.

    Args:
        policy: acts in every copy.
        spec: the problem to solve; or a preset's name, or a spec file.
        name: the policy's name in tables.
        n_episodes: number of seeds to use.
        block: the reserved `evaluation` seeds, or the `validation` seeds, on which settings are
            chosen.
        seeds: of the episodes, in place of those of a block, [E].
        n_copies: number of episodes that run at the same time.
        n_threads: threads that step them, as `make_env` takes it.
        policy_threads: threads of the policy's matrix products; a small network is slower on two.
        progress: whether to show a progress bar (on standard error, if that is a terminal).
        report: called with the number of episodes that have just finished.

    Raises:
        SchemaError: `n_episodes` is not positive, or the policy's actions are malformed.
    """
    if seeds is not None:
        n_episodes = len(seeds)
    if n_episodes < 1:
        raise SchemaError(f"n_episodes is {n_episodes}, expected at least 1.")
    spec = find_spec(spec)
    seeds = block_seeds(block, n_episodes) if seeds is None else seeds
    metrics = {metric: np.empty(n_episodes) for metric in metrics_of(spec.task)}
    env = make_env(spec, min(n_copies, n_episodes), n_threads=n_threads)
    hidden = None if progress else True  # None: hidden unless standard error is a terminal
    with (
        closing(env),
        tqdm(total=n_episodes, desc=name, unit="episode", disable=hidden) as bar,
    ):

        def count(episodes: int) -> None:
            bar.update(episodes)
            report(episodes)

        episodes = rollout(env, policy, seeds, policy_threads=policy_threads, progress=count)
        for row, episode in enumerate(episodes):
            for metric, value in episode_metrics(episode, env.task).items():
                metrics[metric][row] = value
    return EvalResult(name, spec.task, spec.hash(), seeds, metrics)


def check_comparable(results: Sequence[EvalResult]) -> None:
    """Checks that all results were measured on one spec and the same seeds.

    Raises:
        SchemaError: there is no result, or two differ in spec or seeds.
    """
    if not results:
        raise SchemaError("there are no results to compare, expected at least one.")
    first = results[0]
    for other in results[1:]:
        if other.spec_hash != first.spec_hash:
            raise SchemaError(
                f"results of {first.policy!r} and {other.policy!r} are of different specs: "
                f"{first.task} {first.spec_hash[:12]} and {other.task} {other.spec_hash[:12]}. "
                "Evaluate both on one spec."
            )
        if not np.array_equal(other.seeds, first.seeds):
            raise SchemaError(
                f"results of {first.policy!r} and {other.policy!r} are on different seeds "
                f"({len(first.seeds)} and {len(other.seeds)} episodes). Evaluate both with the "
                "same n_episodes."
            )
