"""The recipes of the shipped datasets: the policies of each tier of each preset, and their shares.

`<preset>-<tier>` has a million joint steps; `<preset>-<tier>-mini` has its first 5 %, the same
episodes. The learned tiers mix independently trained checkpoints, with action noise. A tier is
absent where a preset has no checkpoints for it. Presets with conventions have a tier of their own:
scripted teams, half of which follow one convention and half the other.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Annotated, NamedTuple

from pydantic import Field

from swarmdata.errors import BuildError, UnknownNameError
from swarmdata.registry.presets import LazyTable, preset
from swarmdata.specs.frozen import Frozen, NonNegative, Positive
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import WORLD_VERSION, TaskSpec

NEWEST_VERSION = WORLD_VERSION
"""Version of an id that names none: worlds, tiers and ids have one version together."""

N_STEPS, MINI_STEPS = 1_000_000, 50_000

LEARNED_FAMILIES = (
    "coop_nav", "formation", "transport", "warehouse", "coop_nav-n8", "formation-n8",
    "intersection", "search", "pursuit", "coop_nav-corridor-strict", "robotarium",
    "coop_nav-swap-strict", "warehouse-n8", "coop_nav-mixed",
)  # fmt: skip
"""Presets that have policies of their own."""

SCRIPTED_FAMILIES = tuple(name for name in LEARNED_FAMILIES if name != "pursuit")
"""Those that have scripted data, too; the controller of `pursuit` is slow."""

STRICT_FAMILIES = MappingProxyType(
    {
        f"{name}-strict": name
        for name in ("coop_nav", "coop_nav-n8", "intersection", "search", "warehouse")
    }
)
"""Presets in which a contact ends the episode without success, and those without this rule, whose
policies record their data; other teams than experts hardly ever succeed there."""

CONVENTION_FAMILIES = ("coop_nav-lanes", "coop_nav-ranks")
"""Presets that have datasets of scripted teams with conventions; these teams are their experts."""

FAMILIES = (*LEARNED_FAMILIES, *STRICT_FAMILIES, *CONVENTION_FAMILIES)
"""Presets that have datasets."""

FAMILY_SPECS = LazyTable(FAMILIES, preset)
"""The specs of these presets, by name."""

ACTION_NOISE_STD = 0.1
"""Standard deviation of the action noise of learned policies; actions are in [-1, 1]."""


@dataclass(frozen=True)
class Tier:
    """The policies of a tier's datasets."""

    ingredients: tuple[str, ...]  # registered policies or tiers of the index, in equal shares
    seed: int  # of the recipe; it differs from tier to tier, so that tiers share no episode
    noise: float = ACTION_NOISE_STD
    """Standard deviation of the action noise of learned policies, and of teams with conventions; if
    the index records the noise of training, that is used instead."""
    first_only: bool = False  # whether only the first checkpoint of each ingredient is used
    families: tuple[str, ...] = LEARNED_FAMILIES  # presets that have this tier


TIERS = MappingProxyType(
    {
        "random": Tier(("random",), 1),
        "scripted": Tier(("scripted",), 2, families=SCRIPTED_FAMILIES),
        "medium": Tier(("medium",), 3),
        "expert": Tier(("expert",), 4, families=(*LEARNED_FAMILIES, *STRICT_FAMILIES)),
        "medium-expert": Tier(("medium", "expert"), 5),
        "medium-replay": Tier(
            ("medium-replay",), 6, families=(*LEARNED_FAMILIES, *STRICT_FAMILIES)
        ),
        "mixed-conventions": Tier(("mixed-conventions",), 7, noise=0.05, families=("coop_nav",)),
        "narrow": Tier(("expert",), 8, noise=0.02, first_only=True, families=("coop_nav",)),
        "two-conventions": Tier(("two-conventions",), 9, noise=0.05, families=CONVENTION_FAMILIES),
    }
)

TRAINED_TIERS = ("medium", "expert", "medium-replay", "mixed-conventions")
"""Tiers that have checkpoints of their own in the index."""


class Checkpoint(Frozen):
    """A file in `behavior_policies/checkpoints`."""

    file: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    frames: Annotated[int, Field(ge=1)]  # joint steps of training
    policy: Annotated[int, Field(ge=0)]  # index of the independent training run
    share: Positive  # of the steps up to medium that it stands for in a replay; 1 elsewhere
    noise: NonNegative | None = None  # standard deviation in training; None for the tier's
    figures: dict[str, float]  # means over the validation episodes


@cache
def checkpoints(family: str, tier: str) -> tuple[Checkpoint, ...]:
    """Returns the shipped checkpoints of a tier of a preset; none if it has not been trained."""
    found = _index().get(STRICT_FAMILIES.get(family, family), {}).get(tier, ())
    return tuple(Checkpoint.parse(each, f"checkpoint of {family}-{tier}") for each in found)


@cache
def _index() -> dict[str, dict[str, list[dict[str, object]]]]:
    """`checkpoints/index.json`: preset, then tier, then its checkpoints."""
    # from the package's folder: nothing of the folder with the policies is imported
    file = files("swarmdata") / "behavior_policies" / "checkpoints" / "index.json"
    index: dict[str, dict[str, list[dict[str, object]]]] = json.loads(file.read_text("utf-8"))
    return index


def sources(
    family: str, ingredient: str, noise: float | None = None, default: float = ACTION_NOISE_STD
) -> tuple[PolicySource, ...]:
    """Returns the policies of one ingredient of a tier; none if the preset does not have it.

    Args:
        family: a preset's name.
        ingredient: a registered scripted policy, a tier of the index, or `two-conventions`, which
            is the `expert` too where there are conventions.
        noise: standard deviation of the action noise of learned policies, and of teams with
            conventions; None for that of their training.
        default: standard deviation where the index does not record that of training.

    Raises:
        BuildError: the index has no medium of a replay's run.
    """
    if ingredient in ("random", "scripted"):
        return (PolicySource(label=ingredient, name=ingredient),)
    if family in CONVENTION_FAMILIES and ingredient in ("two-conventions", "expert"):
        std = default if noise is None else noise
        return tuple(
            PolicySource(label=each, name="scripted", noise=std, convention=each)
            for each in FAMILY_SPECS[family].rules.conventions
        )
    found = []
    for index, checkpoint in enumerate(checkpoints(family, ingredient)):
        recorded = default if checkpoint.noise is None else checkpoint.noise
        source = PolicySource(
            label=f"{ingredient}-{index}",
            name="learned",
            checkpoint=checkpoint.file,
            sha256=checkpoint.sha256,
            noise=recorded if noise is None else noise,
            share=_weight(family, ingredient, checkpoint),
        )
        found.append(source)
    return tuple(found)


def _weight(family: str, ingredient: str, checkpoint: Checkpoint) -> float:
    """Weight of a checkpoint in its group: in a replay, the training steps that it stands for."""
    if ingredient != "medium-replay":
        return checkpoint.share
    mediums = checkpoints(family, "medium")
    frames = [each.frames for each in mediums if each.policy == checkpoint.policy]
    if len(frames) != 1:
        raise BuildError(
            f"checkpoint {checkpoint.file} is of run {checkpoint.policy} of {family}, which has "
            f"{len(frames)} mediums in checkpoints/index.json, expected one. Ship both together."
        )
    return checkpoint.share * frames[0]


def _mix(groups: Sequence[Sequence[PolicySource]]) -> tuple[PolicySource, ...]:
    """Gives every group the same share of the steps; shares within a group stay in proportion.

    Equal shares become whole numbers, which are exact.
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
    """Returns the number of episodes in a part, a power of two from 4 to 256.

    It is at most half of the episodes that the policy with the least share needs if they are as
    long as the horizon: smaller parts waste less at the end, larger ones fill the copies of a
    world.
    """
    least = min(policy.share for policy in policies) / sum(policy.share for policy in policies)
    wanted = int(n_steps * least / (2 * spec.horizon))
    return 1 << (min(256, max(4, wanted)).bit_length() - 1)


class Outline(NamedTuple):
    """What a shipped recipe is made of."""

    family: str  # the preset
    tier: str
    n_steps: int


@cache
def outlines() -> Mapping[str, Outline]:
    """Returns what the shipped recipes are made of, by id; tiers without checkpoints are absent."""
    sizes = (("", N_STEPS), ("-mini", MINI_STEPS))
    return {
        f"{family}-{name}{suffix}-v{NEWEST_VERSION}": Outline(family, name, n_steps)
        for name, tier in TIERS.items()
        for family in tier.families
        if all(_has(family, each) for each in tier.ingredients)
        for suffix, n_steps in sizes
    }


@cache
def shipped_recipes() -> Mapping[str, Recipe]:
    """Returns the shipped recipes by id, with version.

    A recipe is made when it is first looked at.
    """
    made_of = outlines()
    return LazyTable(made_of, lambda key: _recipe(key, made_of[key]))


def _has(family: str, ingredient: str) -> bool:
    """Whether a preset has the policies of an ingredient."""
    is_scripted = ingredient in ("random", "scripted") or family in CONVENTION_FAMILIES
    known = _index().get(STRICT_FAMILIES.get(family, family), {})
    return is_scripted or bool(known.get(ingredient))


def _recipe(dataset_id: str, outline: Outline) -> Recipe:
    family, name, n_steps = outline
    tier, spec = TIERS[name], FAMILY_SPECS[family]
    groups = [sources(family, each, default=tier.noise) for each in tier.ingredients]
    policies = _mix([group[:1] for group in groups] if tier.first_only else groups)
    return Recipe(
        id=dataset_id,
        tier=name,
        spec=spec,
        policies=policies,
        seed=tier.seed,
        n_steps=n_steps,
        part_episodes=part_size(spec, policies, n_steps),
    )


@cache
def find_recipe(dataset_id: str) -> Recipe:
    """Returns the shipped recipe of an id; without a version, the newest.

    Raises:
        UnknownNameError: no shipped recipe has this id; the message names the nearest one.
    """
    if not is_dataset(dataset_id):
        raise UnknownNameError("dataset", dataset_id, map(without_version, shipped_recipes()))
    recipes = shipped_recipes()
    return next(recipes[each] for each in versions_of(dataset_id) if each in recipes)


def is_dataset(name: str) -> bool:
    """Whether a shipped recipe has this id, with or without its version."""
    return any(each in shipped_recipes() for each in versions_of(name))


def versions_of(name: str) -> tuple[str, str]:
    """The ids that a name may stand for: itself, and with the newest version."""
    return name, f"{name}-v{NEWEST_VERSION}"
