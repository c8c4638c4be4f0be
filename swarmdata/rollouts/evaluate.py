"""Evaluates a policy on seeds that no dataset has; `result_files` stores the result."""

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from tqdm import tqdm

from swarmdata.errors import SchemaError, SpecError, check_type
from swarmdata.interfaces import Policy
from swarmdata.numerics.random import SeedBlock, block_seeds, checked_seeds
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.metrics import episode_metrics, metrics_of, metrics_of_side
from swarmdata.rollouts.rollout import rollout
from swarmdata.rollouts.side_policy import play_sides
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EvalResult, Seeds


def evaluate(
    policy: Policy | str,
    spec: TaskSpec | Path | str,
    *,
    name: str = "policy",
    n_episodes: int = 1000,
    block: SeedBlock = "evaluation",
    seeds: Seeds | None = None,
    side: str | SideSpec | None = None,
    opponents: Policy | str | None = None,
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
        policy: acts in every copy; or the name of a registered policy.
        spec: the problem to solve; or a preset's name, or a spec file.
        name: the policy's name in tables.
        n_episodes: number of seeds to use.
        block: the reserved `evaluation` seeds, or the `validation` seeds, on which settings are
            chosen.
        seeds: of the episodes, in place of those of a block, [E]; all different.
        side: the side that the policy plays, in a task of several. Return, success, clean success
            and time to goal are then those of the side. A policy sees the rows of its side alone,
            as in `dataset.side(...)`, unless it is named. A `SideSpec`: the policy plays all sides,
            and its figures are those of this one.
        opponents: who plays the other sides, given as `policy` is.
        n_copies: number of episodes that run at the same time.
        n_threads: threads that step them, as `make_env` takes it.
        policy_threads: threads of the policy's matrix products; a small network is slower on two.
        progress: whether to show a progress bar (on standard error, if that is a terminal).
        report: called with the number of episodes that have just finished.

    Raises:
        SchemaError: `n_episodes` is not positive, or the policy's actions are malformed.
        UnknownNameError: the task has no such side, or there is no such policy or block of seeds.
        SpecError: the task has one side, or a side is given without opponents, or they without it.
    """
    check_type("n_episodes", n_episodes, (int, np.integer), "a whole number")
    n_episodes = n_episodes if seeds is None else len(seeds)
    if n_episodes < 1:
        raise SchemaError(f"n_episodes is {n_episodes}, expected at least 1.")
    given = block_seeds(block, n_episodes) if seeds is None else seeds
    seeds = checked_seeds(given, distinct=True)
    spec = find_spec(spec)
    policy, measured = _team(policy, spec, side, opponents)
    metrics = {metric: np.empty(n_episodes) for metric in metrics_of(spec.task)}
    env = make_env(spec, min(n_copies, n_episodes), n_threads=n_threads)
    hidden = None if progress else True  # None: hidden unless standard error is a terminal
    bar = tqdm(total=n_episodes, desc=name, unit="episode", disable=hidden)
    with closing(env), bar:

        def count(episodes: int) -> None:
            bar.update(episodes)
            report(episodes)

        episodes = rollout(env, policy, seeds, policy_threads=policy_threads, progress=count)
        for row, episode in enumerate(episodes):
            own = metrics_of_side(episode, measured) if isinstance(measured, SideSpec) else {}
            for metric, value in {**episode_metrics(episode, env.task), **own}.items():
                metrics[metric][row] = value
    return EvalResult(name, measured.task, measured.hash(), seeds, metrics)


def _team(
    policy: Policy | str,
    spec: TaskSpec,
    side: str | SideSpec | None,
    opponents: Policy | str | None,
) -> tuple[Policy, TaskSpec | SideSpec]:
    """Who acts, and what is measured; arguments as of `evaluate`."""
    if isinstance(side, str) and opponents is not None:
        who = opponents if isinstance(opponents, str) else type(opponents).__name__
        team = play_sides(spec, side, policy, opponents)
        return team, SideSpec(whole=spec, side=side, opponents=who)
    if isinstance(side, str) or opponents is not None:
        raise SpecError(
            f"got side {side!r} and opponents {opponents!r}, expected both, or neither for a "
            "policy of the whole task"
        )
    acting = make_policy(policy, spec) if isinstance(policy, str) else policy
    return acting, spec if side is None else side


def check_comparable(results: Sequence[EvalResult]) -> None:
    """Checks that all results were measured on one spec and the same seeds."""
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
