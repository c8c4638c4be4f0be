"""The episodes of a recipe: their seeds, and the policies that act in them."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.interfaces import Policy
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.registry.components import make_policy
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Int, Seeds

SIMULATED_COPIES = 64
"""Copies of a task that are stepped together; episodes are the same for any number."""


def episode_seeds(recipe: Recipe, policy: int, first: int, n_episodes: int) -> Seeds:
    """Returns the seeds of consecutive episodes in a policy's stream, [n_episodes].

    The top two bits are clear, so they never meet the reserved evaluation seeds.
    """
    return stream_seeds(recipe, policy, np.arange(first, first + n_episodes, dtype=np.int64))


def stream_seeds(recipe: Recipe, policy: int, episodes: Int) -> Seeds:
    """The same of any episodes of the stream, by their index in it, [n]."""
    return derive(recipe.seed, policy, episodes) & np.uint64(EVALUATION_BASE - 1)


def make_source_policy(source: PolicySource, spec: TaskSpec, folder: Path | None = None) -> Policy:
    """Builds a behavior policy as the recipe states it, noise included.

    Args:
        source: of the recipe.
        spec: the task.
        folder: of the dataset, which may have checkpoints of its own; None: only the package's.
    """
    options: dict[str, Any] = {"checkpoint": source.checkpoint, "sha256": source.sha256}
    if source.checkpoint is not None:
        options["folder"] = folder
    options = {name: value for name, value in options.items() if value is not None}
    if source.noise:
        options["noise"] = source.noise
    return make_policy(source.name, spec, **options)
