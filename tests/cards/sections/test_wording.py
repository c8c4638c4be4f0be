"""Every tier and task of the package is explained."""

import pytest

from swarmdata.behavior_policies.tiers import shipped_recipes
from swarmdata.cards.sections.wording import (
    COMMON_LIMITS,
    TASK_LIMITS,
    TIER_DESCRIPTIONS,
    TIER_LIMITS,
    limits_of,
)
from swarmdata.registry.components import TASKS


def test_shipped_tiers_have_a_meaning_and_limits() -> None:
    for recipe in shipped_recipes().values():
        assert recipe.tier in TIER_DESCRIPTIONS
    assert set(TIER_DESCRIPTIONS) == set(TIER_LIMITS)


def test_every_task_has_limits() -> None:
    assert set(TASK_LIMITS) == set(TASKS)


@pytest.mark.parametrize("tier", TIER_DESCRIPTIONS)
def test_texts_are_sentences(tier: str) -> None:
    for text in (TIER_DESCRIPTIONS[tier], *limits_of("coop_nav", tier)):
        assert text.endswith(".")
        assert text[0].isupper()
        assert "  " not in text


def test_limits_are_those_of_all_the_task_and_the_tier() -> None:
    found = limits_of("warehouse", "narrow")
    assert found == (*COMMON_LIMITS, *TASK_LIMITS["warehouse"], *TIER_LIMITS["narrow"])
    assert limits_of("elsewhere", "own") == COMMON_LIMITS
