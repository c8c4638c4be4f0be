"""The tiers of the shipped datasets and the presets that have them, without specs and networks.

`<preset>-<tier>` has a million joint steps; `<preset>-<tier>-mini` has its first 5 % of episodes.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import NamedTuple

from swarmdata.specs import WORLD_VERSION

NEWEST_VERSION = WORLD_VERSION
"""Version of an id that names none: worlds, tiers and ids have one version together."""

N_STEPS, MINI_STEPS = 1_000_000, 50_000

LEARNED_FAMILIES = (
    "coop_nav", "formation", "transport", "warehouse", "coop_nav-n8", "formation-n8",
    "intersection", "search", "pursuit", "coop_nav-corridor-strict", "robotarium",
    "coop_nav-swap-strict", "warehouse-n8", "coop_nav-mixed", "search-lift", "coop_nav-n16", "tag",
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

FAMILIES = (*LEARNED_FAMILIES, *STRICT_FAMILIES, *CONVENTION_FAMILIES)  # presets that have datasets

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


def _has(family: str, ingredient: str) -> bool:
    """Whether a preset has the policies of an ingredient."""
    is_scripted = ingredient in ("random", "scripted") or family in CONVENTION_FAMILIES
    known = checkpoint_index().get(STRICT_FAMILIES.get(family, family), {})
    return is_scripted or bool(known.get(ingredient))


@cache
def checkpoint_index() -> dict[str, dict[str, list[dict[str, object]]]]:
    """`checkpoints/index.json`: preset, then tier, then its checkpoints."""
    # from the package's folder: nothing of the folder with the policies is imported
    file = files("swarmdata") / "behavior_policies" / "checkpoints" / "index.json"
    index: dict[str, dict[str, list[dict[str, object]]]] = json.loads(file.read_text("utf-8"))
    return index
