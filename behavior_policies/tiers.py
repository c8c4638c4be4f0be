"""The recipes of the shipped datasets: which policies make each tier of each task, and how much.

`<task>-<tier>` has a million joint steps, `<task>-<tier>-mini` is its first 5 %: the same episodes.
The learned tiers mix several independently trained checkpoints, with action noise.
"""

import json
import math
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Annotated

from pydantic import Field, RootModel

from swarmdata.errors import UnknownNameError
from swarmdata.frozen import Frozen
from swarmdata.presets import preset
from swarmdata.spec import PolicySource, Recipe

VERSION = 0
"""Version of the ids without one: the newest."""

N_STEPS, MINI_STEPS = 1_000_000, 50_000
NOISE = 0.1  # of learned policies, as standard deviation of each action in [-1, 1]

SPECS = MappingProxyType({"coop_nav": preset("coop_nav")})
"""The specs that datasets are made of, by the name of their preset."""

MIXTURES = MappingProxyType(
    {
        "random": (("random",), 1),
        "scripted": (("scripted",), 2),
        "medium": (("medium",), 3),
        "expert": (("expert",), 4),
        "medium-expert": (("medium", "expert"), 5),
    }
)
"""Per tier its ingredients, in equal shares, and the recipe's seed."""


class Checkpoint(Frozen):
    """A file in `behavior_policies/checkpoints`."""

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    frames: int  # joint steps of training
    figures: dict[str, float]  # means over the selection episodes


class Index(RootModel[dict[str, dict[str, tuple[Checkpoint, ...]]]]):
    """`checkpoints/index.json`: task, then tier, then its checkpoints."""


@cache
def checkpoints(task: str, tier: str) -> tuple[Checkpoint, ...]:
    """The shipped checkpoints of a learned tier, none where it has not been trained."""
    text = (files("swarmdata.behavior_policies") / "checkpoints" / "index.json").read_text("utf-8")
    return Index.model_validate(json.loads(text)).root.get(task, {}).get(tier, ())


def sources(task: str, ingredient: str, noise: float = NOISE) -> tuple[PolicySource, ...]:
    """The policies behind one ingredient of a mixture, none where it has not been trained.

    Args:
        task: task name.
        ingredient: a registered scripted policy, or a learned tier.
        noise: standard deviation of the action noise of learned policies.
    """
    if ingredient in ("random", "scripted"):
        return (PolicySource(label=ingredient, name=ingredient),)
    return tuple(
        PolicySource(
            label=f"{ingredient}-{index}",
            name="learned",
            checkpoint=checkpoint.file,
            sha256=checkpoint.sha256,
            noise=noise,
        )
        for index, checkpoint in enumerate(checkpoints(task, ingredient))
    )


def _mix(groups: Sequence[Sequence[PolicySource]]) -> tuple[PolicySource, ...]:
    """Gives every group the same share of the steps, in whole numbers."""
    whole = math.lcm(*map(len, groups))
    return tuple(
        source.model_copy(update={"share": float(whole // len(group))})
        for group in groups
        for source in group
    )


@cache
def shipped_recipes() -> MappingProxyType[str, Recipe]:
    """Every shipped recipe by its id, version included; tiers without checkpoints are absent."""
    recipes = {}
    for task, spec in SPECS.items():
        for tier, (ingredients, seed) in MIXTURES.items():
            groups = [sources(task, ingredient) for ingredient in ingredients]
            if not all(groups):
                continue
            for suffix, n_steps, part_episodes in (("", N_STEPS, 256), ("-mini", MINI_STEPS, 64)):
                recipe = Recipe(
                    id=f"{task}-{tier}{suffix}-v{VERSION}",
                    tier=tier,
                    spec=spec,
                    policies=_mix(groups),
                    seed=seed,
                    n_steps=n_steps,
                    part_episodes=part_episodes,
                )
                recipes[recipe.id] = recipe
    return MappingProxyType(recipes)


def find_recipe(dataset_id: str) -> Recipe:
    """Returns the shipped recipe of an id; without a version it is the newest.

    Raises:
        UnknownNameError: with the nearest known id.
    """
    newest = _newest()
    recipe = shipped_recipes().get(dataset_id) or newest.get(dataset_id)
    if recipe is None:
        raise UnknownNameError("dataset", dataset_id, newest)
    return recipe


def is_dataset(name: str) -> bool:
    """Whether a shipped recipe has this id, with or without its version."""
    return name in shipped_recipes() or name in _newest()


def _newest() -> dict[str, Recipe]:
    """Recipes by id without version."""
    return {key.rpartition("-v")[0]: recipe for key, recipe in shipped_recipes().items()}
