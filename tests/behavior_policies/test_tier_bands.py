"""Figures outside of their bands are named, each of them; figures inside are not."""

import pytest

from swarmdata.behavior_policies.tier_bands import EXPERT_AT_LEAST, out_of_band
from swarmdata.registry.tiers import FAMILIES
from tests.support.measured import reference_specs

GOOD = {
    "idle": {"return": -5.0},
    "random": {"return": -9.0},
    "scripted": {"return": 5.0},
    "medium": {"success": 0.4},
    "expert": {"success": 0.95, "clean_success": 0.85, "return": 4.5},
}


def changed(policy: str, metric: str, value: float) -> dict[str, dict[str, float]]:
    return {**GOOD, policy: {**GOOD[policy], metric: value}}


def test_every_preset_with_datasets_has_bands() -> None:
    assert set(EXPERT_AT_LEAST) == {name for each in FAMILIES for name in reference_specs(each)}


@pytest.mark.parametrize("name", EXPERT_AT_LEAST)
def test_good_figures_pass_everywhere(name: str) -> None:
    assert out_of_band(name, GOOD) == ()


@pytest.mark.parametrize(
    ("policy", "metric", "value", "message"),
    [
        ("medium", "success", 0.39, "coop_nav: medium success is 0.390, expected 0.4 to 0.6"),
        ("medium", "success", 0.61, "medium success is 0.610"),
        ("expert", "success", 0.94, "expert success is 0.940, expected at least 0.95"),
        ("expert", "clean_success", 0.84, "expert clean_success is 0.840"),
        ("expert", "return", 4.4, "expert return is 4.400, expected at least 4.500, which is 95%"),
        ("expert", "return", float("nan"), "expert return is nan"),
    ],
)
def test_each_figure_is_checked(policy: str, metric: str, value: float, message: str) -> None:
    (problem,) = out_of_band("coop_nav", changed(policy, metric, value))
    assert message in problem


def test_policies_of_another_preset_are_held_to_the_bounds_of_this_one_only() -> None:
    figures = changed("medium", "success", 0.0) | {"expert": {"success": 0.71, "return": 0.0}}
    assert out_of_band("search-strict", figures, is_borrowed=True) == ()
    assert len(out_of_band("search-strict", figures)) == 2
    figures["expert"]["success"] = 0.69
    (problem,) = out_of_band("search-strict", figures, is_borrowed=True)
    assert "expected at least 0.7" in problem


def test_pushing_may_touch() -> None:
    assert out_of_band("transport", changed("expert", "clean_success", 0.0)) == ()
