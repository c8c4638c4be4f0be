"""The seeds of a recipe's episodes, and the policies that act in them."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.interfaces import Policy
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.registry.components import make_policy
from swarmdata.rollouts.side_policy import SidePolicy
from swarmdata.specs.origins import SideSpec
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


def make_source_policy(
    source: PolicySource, spec: TaskSpec | SideSpec, folder: Path | None = None
) -> Policy:
    """Builds a recipe's policy, noise included; its checkpoint may be in the dataset's folder.

    A spec of a side is for a policy without opponents, which plays that side.
    """
    if source.opponents and isinstance(spec, TaskSpec):
        seats = dict(zip((side.name for side in spec.sides), source.acting, strict=True))
        own = [name for name, each in seats.items() if each.checkpoint is not None]
        task = {name: SideSpec(whole=spec, side=name) if name in own else spec for name in seats}
        return SidePolicy(
            spec, {name: _make(each, task[name], folder) for name, each in seats.items()}, own
        )
    return _make(source, spec, folder)


def _make(source: PolicySource, spec: TaskSpec | SideSpec, folder: Path | None) -> Policy:
    """One policy of a whole task, or one that was trained for the side it plays."""
    options: dict[str, Any] = {
        "checkpoint": source.checkpoint,
        "sha256": source.sha256,
        "convention": source.convention,
        "folder": None if source.checkpoint is None else folder,
        "noise": source.noise or None,
    }
    given = {name: value for name, value in options.items() if value is not None}
    return make_policy(source.name, spec, **given)
