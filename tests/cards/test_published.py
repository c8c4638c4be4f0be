"""What the package says of its tasks and datasets holds together; tiers keep their bands."""

from importlib.resources import files

import pytest

from swarmdata.behavior_policies.tier_bands import EXPERT_AT_LEAST, out_of_band
from swarmdata.cards.sections.origin import tier_section
from swarmdata.cards.sections.problem import definitions_section, reward_section
from swarmdata.cards.worlds_page import worlds_pages
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset
from swarmdata.registry.published import published, references
from swarmdata.registry.recipes import checkpoints, shipped_recipes
from swarmdata.registry.tiers import FAMILIES, STRICT_FAMILIES
from tests.support.measured import reference_specs


def means(family: str) -> dict[str, dict[str, float]]:
    """Measured means by policy and metric; those that are never defined are left out."""
    return {
        policy: {name: value.value for name, value in metrics.items() if value is not None}
        for policy, metrics in references()[family].policies.items()
    }


@pytest.mark.parametrize("family", FAMILIES)
def test_trained_tiers_were_measured_on_the_headline_spec(family: str) -> None:
    trained = {tier for tier in ("medium", "expert") if checkpoints(family, tier)}
    assert all(references()[name].policies.keys() >= trained for name in reference_specs(family))


@pytest.mark.parametrize("name", EXPERT_AT_LEAST)
def test_tasks_leave_room(name: str) -> None:
    figures = means(name)
    no_skill = max(figures[policy]["return"] for policy in ("idle", "random"))
    assert figures["straight"]["return"] <= (no_skill + figures["expert"]["return"]) / 2
    assert figures["straight"]["clean_success"] <= 0.5
    learned = ("expert",) if name in STRICT_FAMILIES else ("medium", "expert")
    known = [policy for policy in learned if policy in figures]
    returns = [figures[policy]["return"] for policy in known]
    assert returns == sorted(returns)
    assert all(value > figures["random"]["return"] for value in returns)
    more_than_idle = returns if name in FAMILIES else returns[-1:]  # sides touch each other
    assert all(value > figures["idle"]["return"] for value in more_than_idle)


@pytest.mark.parametrize("family", [f for f in EXPERT_AT_LEAST if "medium" in means(f)])
def test_measured_tiers_lie_in_their_bands(family: str) -> None:
    is_borrowed = family in STRICT_FAMILIES
    assert out_of_band(family, means(family), is_borrowed=is_borrowed) == ()


def test_every_published_dataset_has_a_recipe_and_a_card() -> None:
    assert set(published()) <= set(shipped_recipes())
    for key, entry in published().items():
        card = (files("swarmdata.cards") / "published" / f"{key}.md").read_text("utf-8")
        assert entry.digest in card
        assert entry.recipe_hash == shipped_recipes()[key].hash()
        assert entry.recipe_hash in card
        recipe = shipped_recipes()[key]
        assert (entry.task, entry.n_agents) == (recipe.spec.task, recipe.spec.n_agents)
        assert tier_section(recipe) in card
        task = make_task(recipe.spec)
        assert reward_section(task) in card
        assert definitions_section(task) in card


@pytest.mark.parametrize("tier", ["medium", "expert", "mixed-conventions"])
@pytest.mark.parametrize("family", FAMILIES)
def test_learned_tiers_mix_independent_policies(family: str, tier: str) -> None:
    shipped = checkpoints(family, tier)
    assert len({each.sha256 for each in shipped}) == len(shipped)
    assert len({(each.side, each.policy) for each in shipped}) == len(shipped)
    assert len(shipped) == 0 or len(shipped) >= (2 if tier == "mixed-conventions" else 3)


def test_a_preset_that_was_not_measured_is_named() -> None:
    known = dict(references())
    del known["formation"]
    pages = worlds_pages(known)
    assert pages["formation.md"].count("This version of the preset was not measured.") == 1
    assert "[`formation`](formation.md#formation) |  |  |  |  |" in pages["README.md"]


@pytest.mark.parametrize("name", sorted(set(references()) - {"tag-evader"}))  # who wins seldom
def test_the_scripted_team_solves_what_others_do_not(name: str) -> None:
    random, idle, scripted = (means(name)[policy] for policy in ("random", "idle", "scripted"))
    assert scripted["success"] >= 0.8
    assert max(random["success"], idle["success"]) <= 0.01
    assert max(random["return"], idle["return"]) < scripted["return"]
    spec = preset(name.removesuffix("-pursuers"))
    ends_at_contact = spec.on_collision == "fail"  # then moving at random is over soon
    assert ends_at_contact or random["return"] < idle["return"]
