"""Every tier and task of the package is explained."""

import re
from typing import Any

import pytest

from swarmdata.cards.sections.origin import tier_section
from swarmdata.cards.sections.wording import (
    SIDE_TIER_DESCRIPTIONS,
    STRICT_NOTE,
    TIER_DESCRIPTIONS,
    TIER_LIMITS,
    limits_of,
)
from swarmdata.registry.presets import preset
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe, shipped_recipes
from swarmdata.registry.tiers import STRICT_FAMILIES


def test_shipped_tiers_have_a_meaning_and_limits() -> None:
    for recipe in shipped_recipes().values():
        assert recipe.tier in TIER_DESCRIPTIONS
    assert set(TIER_DESCRIPTIONS) == set(TIER_LIMITS)


@pytest.mark.parametrize(
    ("tier", "words", "least", "most"),
    [
        ("random", "success is almost never seen", 0.0, 0.01),
        ("medium", "Many episodes fail", 0.2, 0.65),
        ("medium-replay", "most episodes fail", 0.01, 0.5),
        ("expert", "Most episodes succeed", 0.75, 1.0),
        ("mixed-conventions", "Nearly every episode is good", 0.95, 1.0),
        ("narrow", "high returns", 0.95, 1.0),
    ],
)
def test_what_tiers_say_of_success_is_true_of_all_published_data(
    tier: str, words: str, least: float, most: float
) -> None:
    assert words in TIER_DESCRIPTIONS[tier]
    found = {k: e.success for k, e in published().items() if find_recipe(k).tier == tier}
    is_other = re.compile("-strict-|^tag-")  # which say something else
    found = {k: share for k, share in found.items() if not is_other.search(k)}
    assert found
    assert not {k: share for k, share in found.items() if not least <= share <= most}


def test_tiers_of_sides_are_described_by_who_plays_whom() -> None:
    for tier, text in SIDE_TIER_DESCRIPTIONS.items():
        assert text in tier_section(find_recipe(f"tag-{tier}"))
        assert text not in tier_section(find_recipe(f"pursuit-{tier}"))
    assert TIER_DESCRIPTIONS["random"] in tier_section(find_recipe("tag-random"))


@pytest.mark.parametrize("name", STRICT_FAMILIES)
def test_cards_of_strict_presets_say_why_fewer_episodes_succeed(name: str) -> None:
    base = STRICT_FAMILIES[name]
    for tier in ("medium-replay", "expert"):
        strict, free = (find_recipe(f"{each}-{tier}") for each in (name, base))
        assert published()[strict.id].success < published()[free.id].success
        assert STRICT_NOTE.format(base) in tier_section(strict)
        own = strict.model_copy(update={"id": "search-own-v0"})
        assert "fewer episodes succeed" not in tier_section(own), "of other policies"
        assert "fewer episodes succeed" not in tier_section(free)


@pytest.mark.parametrize(
    "changes",
    [
        {"randomization": {"mass": (1.0, 2.0)}},
        {
            "team": [
                {"name": name, "count": 2, "robot": {"mass": mass}}
                for name, mass in (("a", 1.0), ("b", 2.0))
            ]
        },
    ],
)
def test_robots_have_equal_masses_only_where_they_have(changes: dict[str, Any]) -> None:
    assert "robots of equal mass," in limits_of(preset("coop_nav"), "random")[0]
    changed = preset("coop_nav").with_updates(**changes)
    assert "robots of different masses," in limits_of(changed, "random")[0]
