"""The shipped recipes."""

from types import MappingProxyType

import pytest

from swarmdata.behavior_policies import tiers
from swarmdata.behavior_policies.learned import read_checkpoint
from swarmdata.behavior_policies.tiers import (
    Checkpoint,
    checkpoints,
    find_recipe,
    is_dataset,
    shipped_recipes,
    sources,
)
from swarmdata.errors import UnknownNameError
from swarmdata.spec import Recipe


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> MappingProxyType[str, Recipe]:
    """The recipes there would be with three medium and two expert checkpoints."""
    table = {
        tier: tuple(
            Checkpoint(file=f"{tier}-{k}.safetensors", sha256="a" * 64, frames=1, figures={})
            for k in range(n)
        )
        for tier, n in (("medium", 3), ("expert", 2))
    }
    monkeypatch.setattr(tiers, "checkpoints", lambda task, tier: table[tier])
    return shipped_recipes.__wrapped__()


def test_without_version_means_the_newest() -> None:
    assert find_recipe("coop_nav-random") is find_recipe("coop_nav-random-v0")
    assert is_dataset("coop_nav-random")
    assert not is_dataset("random")


def test_unknown_id_or_version() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'coop_nav-random'"):
        find_recipe("coop_nav-random-v7")


def test_every_tier_has_a_mini_of_the_same_episodes(
    trained: MappingProxyType[str, Recipe],
) -> None:
    names = ("random", "scripted", "medium", "expert", "medium-expert")
    assert set(trained) == {f"coop_nav-{n}{s}-v0" for n in names for s in ("", "-mini")}
    for name in names:
        full, mini = trained[f"coop_nav-{name}-v0"], trained[f"coop_nav-{name}-mini-v0"]
        free = {"id", "n_steps", "part_episodes"}  # none of which decides what an episode is
        assert full.model_dump(exclude=free) == mini.model_dump(exclude=free)
        assert mini.n_steps * 20 == full.n_steps == 1_000_000


def test_no_two_tiers_share_their_episodes(trained: MappingProxyType[str, Recipe]) -> None:
    seeds = {recipe.tier: recipe.seed for recipe in trained.values()}

    assert len(set(seeds.values())) == len(seeds) == 5


def test_mixture_is_half_and_half(trained: MappingProxyType[str, Recipe]) -> None:
    policies = trained["coop_nav-medium-expert-v0"].policies
    shares = {
        kind: sum(p.share for p in policies if p.label.startswith(kind))
        for kind in ("medium", "expert")
    }

    assert len(policies) == 5
    assert shares["medium"] == shares["expert"]
    assert {policy.noise for policy in policies} == {0.1}


def test_reference_policies_have_no_noise(trained: MappingProxyType[str, Recipe]) -> None:
    assert trained
    assert [source.noise for source in sources("coop_nav", "expert", 0.0)] == [0.0, 0.0]
    assert sources("coop_nav", "scripted")[0].noise == 0.0


@pytest.mark.parametrize("tier", ["medium", "expert"])
def test_shipped_checkpoints_are_those_of_the_index(tier: str) -> None:
    for checkpoint in checkpoints("coop_nav", tier):
        assert read_checkpoint(checkpoint.file, checkpoint.sha256)
