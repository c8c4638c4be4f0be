"""Simulates recorded episodes again from the recipe, and reports differences from the files.

It detects changes since the recording, such as those of the physics engine.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError
from swarmdata.numerics.random import derive
from swarmdata.registry.components import make_env
from swarmdata.registry.published import changed_versions
from swarmdata.rollouts.recipe_episodes import SIMULATED_COPIES, episode_seeds, make_source_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.origins import check_installed
from swarmdata.store.assembly import provenance
from swarmdata.types import STATE_FIELDS, STEP_FIELDS, Episode, Int


@dataclass(frozen=True)
class Drift:
    """An episode whose simulation here differs from the recording."""

    episode: int  # in stored order
    problem: str  # the first difference
    versions: tuple[str, ...]  # those that differ from the ones it was recorded with

    def __str__(self) -> str:
        """One line."""
        made = ", ".join(self.versions) or "the same versions"
        return f"episode {self.episode}: {self.problem}; simulated here with {made}"


def replay(dataset: Dataset, n_episodes: int, seed: int = 0) -> tuple[Drift, ...]:
    """Simulates some episodes of a dataset again, bit for bit.

    Args:
        dataset: made from a recipe, not a view of it.
        n_episodes: how many; all of them where there are fewer.
        seed: of the choice.

    Returns:
        Those that differ, in stored order.

    Raises:
        SpecError: the dataset was not made from a recipe.
        UnknownNameError: the recipe names a policy or task that this package does not have.
        CheckpointError: a checkpoint of the recipe has changed.
    """
    check_installed(dataset.recipe, "simulating again")
    chosen = _choose(len(dataset), n_episodes, seed)
    versions = changed_versions(dataset.stored.manifest.provenance, provenance(dataset.spec.world))
    drifts = []
    policies = dataset.stored.table.policy[chosen]
    for policy in np.unique(policies).tolist():
        of_policy = chosen[policies == policy]
        for index, episode in zip(
            of_policy.tolist(), _simulate(dataset, policy, of_policy), strict=True
        ):
            problem = _difference(dataset[index], episode)
            if problem:
                drifts.append(Drift(index, problem, versions))
    return tuple(sorted(drifts, key=lambda drift: drift.episode))


def _choose(n: int, wanted: int, seed: int) -> Int:
    """Indices of `wanted` of n episodes, ascending."""
    order = np.argsort(derive(seed, 0, np.arange(n, dtype=np.uint64)))
    return np.sort(order[:wanted])


def _simulate(dataset: Dataset, policy: int, episodes: Int) -> list[Episode]:
    """Runs the recipe's policy on the seeds that the recipe gives these episodes."""
    recipe = dataset.recipe.recipe
    if recipe is None:
        raise SpecError(
            f"{dataset.id} was not made from a recipe, so it cannot be simulated from one. "
            f"`swarmdata audit` replays its logged actions: swarmdata audit {dataset.path}"
        )
    places = dataset.stored.table.policy_episode[episodes].tolist()
    seeds = np.concatenate([episode_seeds(recipe, policy, place, 1) for place in places])
    env = make_env(recipe.spec, min(SIMULATED_COPIES, len(seeds)))
    actor = make_source_policy(recipe.policies[policy], recipe.spec, dataset.path)
    return list(rollout(env, actor, seeds, policy_index=policy))


def _difference(recorded: Episode, again: Episode) -> str | None:
    """The first difference between two episodes, None if there is none."""
    for name in ("seed", "end_reason", "length"):
        one, other = _value(recorded, name), _value(again, name)
        if one != other:
            return f"{name} is {one} in the recording, {other} in the simulation"
    rows = []
    for name in ("layout", *STATE_FIELDS, *STEP_FIELDS, *recorded.optional):
        row = _first_row(getattr(recorded, name), getattr(again, name))
        if row is not None:
            rows.append((row, name))
    return "{1} differ from row {0} on".format(*min(rows)) if rows else None


def _value(episode: Episode, name: str) -> int:
    return len(episode) if name == "length" else int(getattr(episode, name))


def _first_row(one: NDArray[Any], other: NDArray[Any]) -> int | None:
    """The first row whose bits differ; row 0 where dtype or shape does."""
    if (one.dtype, one.shape) != (other.dtype, other.shape):
        return 0
    if one.tobytes() == other.tobytes():
        return None
    return next(row for row, values in enumerate(one) if values.tobytes() != other[row].tobytes())
