"""What the package says of its tasks and datasets holds together; tiers keep their bands."""

from importlib.resources import files

import pytest

from swarmdata.behavior_policies.tiers import SPECS, checkpoints, shipped_recipes
from swarmdata.cards.schema import published, references


@pytest.mark.parametrize("task", SPECS)
def test_references_were_measured_on_the_headline_spec(task: str) -> None:
    found = references()[task]
    assert found.spec_hash == SPECS[task].hash()
    assert found.n_episodes == 1000
    assert set(found.policies) == {"idle", "random", "straight", "scripted", "medium", "expert"}


@pytest.mark.parametrize("task", SPECS)
def test_measured_tiers_lie_in_their_bands(task: str) -> None:
    policies = references()[task].policies

    def value(policy: str, metric: str) -> float:
        interval = policies[policy][metric]
        assert interval is not None
        return interval.value

    assert 0.40 <= value("medium", "success") <= 0.60
    assert value("expert", "success") >= 0.90
    assert value("expert", "clean_success") >= 0.70
    assert value("expert", "return") >= value("scripted", "return")
    assert value("straight", "success") <= 0.50
    order = ["random", "idle", "medium", "expert"]
    returns = [value(policy, "return") for policy in order]
    assert returns == sorted(returns)


def test_every_shipped_recipe_is_published_with_a_card() -> None:
    assert set(published()) == set(shipped_recipes())
    for key, entry in published().items():
        card = (files("swarmdata.cards") / "published" / f"{key}.md").read_text("utf-8")
        assert entry.digest in card
        assert shipped_recipes()[key].hash() in card


@pytest.mark.parametrize("task", SPECS)
def test_learned_tiers_mix_at_least_three_policies(task: str) -> None:
    for tier in ("medium", "expert"):
        digests = {checkpoint.sha256 for checkpoint in checkpoints(task, tier)}
        assert len(digests) >= 3
