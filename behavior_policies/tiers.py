"""The recipes of the shipped datasets: which policies make each tier of each preset, and how much.

`<preset>-<tier>` has a million joint steps, `<preset>-<tier>-mini` is its first 5 %: the same
episodes. The learned tiers mix independently trained checkpoints, with action noise. A tier that a
preset has no checkpoints for is absent.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Annotated

from pydantic import Field, RootModel

from swarmdata.errors import BuildError, UnknownNameError
from swarmdata.registry.presets import preset
from swarmdata.specs.frozen import Frozen, NonNegative, Positive
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec

VERSION = 0
"""Version of the ids without one: the newest."""

N_STEPS, MINI_STEPS = 1_000_000, 50_000

FAMILIES = ("coop_nav", "formation", "transport", "warehouse", "coop_nav-n8", "formation-n8")
"""Presets that datasets are made of."""

SPECS = MappingProxyType({name: preset(name) for name in FAMILIES})
"""Their specs, by name."""

NOISE = 0.1
"""Action noise of learned policies, as standard deviation of each component in [-1, 1]."""


@dataclass(frozen=True)
class Tier:
    """What a tier's datasets are made of.

    Attributes:
        ingredients: registered policies or tiers of the index, in equal shares.
        seed: of the recipe; no two tiers have the same, so they share no episode.
        noise: standard deviation of the action noise of learned policies; where the index records
            that of training, that is used instead.
        first_only: whether only the first checkpoint of each ingredient is used.
        families: presets that have this tier.
    """

    ingredients: tuple[str, ...]
    seed: int
    noise: float = NOISE
    first_only: bool = False
    families: tuple[str, ...] = FAMILIES


TIERS = MappingProxyType(
    {
        "random": Tier(("random",), 1),
        "scripted": Tier(("scripted",), 2),
        "medium": Tier(("medium",), 3),
        "expert": Tier(("expert",), 4),
        "medium-expert": Tier(("medium", "expert"), 5),
        "medium-replay": Tier(("medium-replay",), 6),
        "mixed-conventions": Tier(("mixed-conventions",), 7, noise=0.05, families=("coop_nav",)),
        "narrow": Tier(("expert",), 8, noise=0.02, first_only=True, families=("coop_nav",)),
    }
)

TRAINED = ("medium", "expert", "medium-replay", "mixed-conventions")
"""Tiers that have checkpoints of their own in the index."""


class Checkpoint(Frozen):
    """A file in `behavior_policies/checkpoints`."""

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    frames: Annotated[int, Field(ge=1)]  # joint steps of training
    policy: Annotated[int, Field(ge=0)]  # which independent run
    share: Positive  # part of the run's way to medium that it stands for; 1: not of a replay
    noise: NonNegative | None = None  # standard deviation that training had then; None: the tier's
    figures: dict[str, float]  # means over the selection episodes


class Index(RootModel[dict[str, dict[str, tuple[Checkpoint, ...]]]]):
    """`checkpoints/index.json`: preset, then tier, then its checkpoints."""


@cache
def checkpoints(family: str, tier: str) -> tuple[Checkpoint, ...]:
    """The shipped checkpoints of a tier of a preset, none where it has not been trained."""
    text = (files("swarmdata.behavior_policies") / "checkpoints" / "index.json").read_text("utf-8")
    return Index.model_validate(json.loads(text)).root.get(family, {}).get(tier, ())


def sources(
    family: str, ingredient: str, noise: float | None = None, default: float = NOISE
) -> tuple[PolicySource, ...]:
    """The policies behind one ingredient of a tier, none where it has not been trained.

    Args:
        family: a preset's name.
        ingredient: a registered scripted policy, or a tier of the index.
        noise: standard deviation of the action noise of learned policies; None: that of their
            training where it is recorded, else `default`.
        default: as said.

    Raises:
        BuildError: a replay's run has no medium.
    """
    if ingredient in ("random", "scripted"):
        return (PolicySource(label=ingredient, name=ingredient),)
    found = checkpoints(family, ingredient)
    return tuple(
        PolicySource(
            label=f"{ingredient}-{index}",
            name="learned",
            checkpoint=checkpoint.file,
            sha256=checkpoint.sha256,
            noise=_noise(checkpoint, default) if noise is None else noise,
            share=_weight(family, ingredient, checkpoint),
        )
        for index, checkpoint in enumerate(found)
    )


def _noise(checkpoint: Checkpoint, default: float) -> float:
    return default if checkpoint.noise is None else checkpoint.noise


def _weight(family: str, ingredient: str, checkpoint: Checkpoint) -> float:
    """How much of its group a checkpoint is: in a replay, the frames of training it stands for."""
    if ingredient != "medium-replay":
        return checkpoint.share
    mediums = checkpoints(family, "medium")
    reached = [each.frames for each in mediums if each.policy == checkpoint.policy]
    if len(reached) != 1:
        raise BuildError(
            f"checkpoint {checkpoint.file} is of run {checkpoint.policy} of {family}, which has "
            f"{len(reached)} mediums in checkpoints/index.json, expected one. Ship both together."
        )
    return checkpoint.share * reached[0]


def _groups(family: str, tier: Tier) -> list[tuple[PolicySource, ...]]:
    groups = [sources(family, name, default=tier.noise) for name in tier.ingredients]
    return [group[:1] for group in groups] if tier.first_only else groups


def _mix(groups: Sequence[Sequence[PolicySource]]) -> tuple[PolicySource, ...]:
    """Gives every group the same share of the steps; inside a group the shares stay in proportion.

    Equal shares become whole numbers, so that nothing is rounded where nothing need be.
    """
    whole = math.lcm(*map(len, groups))
    mixed = []
    for group in groups:
        total = math.fsum(source.share for source in group)
        is_equal = len({source.share for source in group}) == 1
        for source in group:
            share = whole // len(group) if is_equal else whole * (source.share / total)
            mixed.append(source.model_copy(update={"share": float(share)}))
    return tuple(mixed)


def part_size(spec: TaskSpec, policies: Sequence[PolicySource], n_steps: int) -> int:
    """Episodes of a part, a power of two from 4 to 256.

    At most half of what the policy with the least share needs if its episodes are as long as the
    horizon: smaller parts waste less at the end, larger ones fill the copies of a world.
    """
    least = min(policy.share for policy in policies) / sum(policy.share for policy in policies)
    wanted = int(n_steps * least / (2 * spec.horizon))
    return 1 << (min(256, max(4, wanted)).bit_length() - 1)


@cache
def shipped_recipes() -> MappingProxyType[str, Recipe]:
    """Every shipped recipe by its id, version included; tiers without checkpoints are absent."""
    recipes = {}
    for name, tier in TIERS.items():
        for family in tier.families:
            groups = _groups(family, tier)
            if not all(groups):
                continue
            policies, spec = _mix(groups), SPECS[family]
            for suffix, n_steps in (("", N_STEPS), ("-mini", MINI_STEPS)):
                recipe = Recipe(
                    id=f"{family}-{name}{suffix}-v{VERSION}",
                    tier=name,
                    spec=spec,
                    policies=policies,
                    seed=tier.seed,
                    n_steps=n_steps,
                    part_episodes=part_size(spec, policies, n_steps),
                )
                recipes[recipe.id] = recipe
    return MappingProxyType(recipes)


@cache
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


@cache
def _newest() -> Mapping[str, Recipe]:
    """Recipes by id without version."""
    return {key.rpartition("-v")[0]: recipe for key, recipe in shipped_recipes().items()}
