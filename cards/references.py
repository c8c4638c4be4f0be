"""Turns evaluations of reference policies into the table that cards and scores use."""

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.registry.published import Interval, TaskReferences
from swarmdata.rollouts.evaluate import check_comparable
from swarmdata.rollouts.score_statistics import bootstrap, mean
from swarmdata.types import Double, EvalResult

BOOTSTRAP_SEED = 0


def summarize(
    results: Mapping[str, Sequence[EvalResult]], backend: str = "pymunk"
) -> TaskReferences:
    """Returns the reference table of one spec.

    A reference of several checkpoints is their mean per episode, so the interval is over episodes
    for these checkpoints.

    Args:
        results: by reference policy, one result per checkpoint; all on the same spec and seeds.
        backend: simulator of the spec.

    Raises:
        SchemaError: no results, or results that cannot be compared.
    """
    flat = [result for group in results.values() for result in group]
    check_comparable(flat)
    empty = [name for name, group in results.items() if not group]
    if empty:
        raise SchemaError(f"reference policies {empty} have no results, expected at least one each")
    return TaskReferences(
        spec_hash=flat[0].spec_hash,
        n_episodes=len(flat[0].seeds),
        made_with=made_with(backend),
        policies={
            name: {
                metric: interval(np.stack([result.metrics[metric] for result in group]))
                for metric in group[0].metrics
            }
            for name, group in results.items()
        },
    )


def made_with(backend: str = "pymunk") -> dict[str, str]:
    """Versions that a number measured in a simulator depends on."""
    packages = ["swarmdata", "numpy", "numba", "pymunk"]
    if backend == "mujoco":
        packages.append("mujoco")
    return {**{name: version(name) for name in packages}, "python": platform.python_version()}


def interval(values: Double) -> Interval | None:
    """Mean with its 95 % bootstrap interval over episodes, None if no episode defines the metric.

    Args:
        values: of each checkpoint and episode, [checkpoints, n_episodes]; NaN is undefined.
    """
    defined = ~np.isnan(values)
    counts = defined.sum(axis=0)
    per_episode = np.where(defined, values, 0.0).sum(axis=0)[counts > 0] / counts[counts > 0]
    if not len(per_episode):
        return None
    generator = np.random.Generator(np.random.PCG64(BOOTSTRAP_SEED))
    estimate = bootstrap(mean, per_episode[:, None], generator=generator)
    return Interval(value=estimate.value, low=estimate.low, high=estimate.high)
