"""The seeds of a recipe's episodes, and the policies that act in them."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.interfaces import Policy
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.registry.components import make_policy
from swarmdata.rollouts.side_policy import SidePolicy
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Int, Seeds

SIMULATED_COPIES = 64
"""Copies of a task that are stepped together; the episodes do not depend on this number."""


def episode_seeds(recipe: Recipe, policy: int, episodes: Int) -> Seeds:
    """Returns the seeds of episodes in a policy's stream, by their index in it, [n].

    Their top two bits are zero, so they never coincide with the reserved evaluation seeds.
    """
    return derive(recipe.seed, policy, episodes) & np.uint64(EVALUATION_BASE - 1)


def make_source_policy(source: PolicySource, spec: TaskSpec, folder: Path | None = None) -> Policy:
    """Builds a behavior policy as the recipe states it, noise included.

    Args:
        source: one of the recipe's policies.
        spec: the task.
        folder: the dataset's folder, which may contain checkpoints; None: only the package's.
    """
    if source.opponents:
        first = source.model_copy(update={"opponents": ()})
        names = [side.name for side in spec.sides]
        seats = zip(names, (first, *source.opponents), strict=True)
        return SidePolicy(
            spec, {name: make_source_policy(each, spec, folder) for name, each in seats}
        )
    options: dict[str, Any] = {
        "checkpoint": source.checkpoint,
        "sha256": source.sha256,
        "convention": source.convention,
        "folder": None if source.checkpoint is None else folder,
        "noise": source.noise or None,
    }
    given = {name: value for name, value in options.items() if value is not None}
    return make_policy(source.name, spec, **given)
