"""The shipped recipes."""

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.behavior_policies.checkpoint_files import read_checkpoint
from swarmdata.errors import BuildError, UnknownNameError
from swarmdata.registry import recipes, tiers
from swarmdata.registry.recipes import (
    FAMILY_SPECS,
    Checkpoint,
    checkpoints,
    find_recipe,
    is_dataset,
    part_size,
    shipped_recipes,
    sources,
)
from swarmdata.registry.tiers import (
    CONVENTION_FAMILIES,
    FAMILIES,
    LEARNED_FAMILIES,
    STRICT_FAMILIES,
    TIERS,
    TRAINED_TIERS,
)
from swarmdata.specs.recipe import PolicySource, Recipe

FRAMES = {0: 1_000_000, 1: 3_000_000}  # joint steps of two runs to their mediums


def checkpoint(tier: str, k: int, **changes: Any) -> Checkpoint:
    fields = {"file": f"{tier}-{k}.safetensors", "sha256": "a" * 64, "frames": 5, "policy": k}
    return Checkpoint.parse({**fields, "share": 1.0, "figures": {}, **changes})


INDEX = {
    "medium": tuple(checkpoint("medium", k, frames=FRAMES[k]) for k in FRAMES),
    "expert": tuple(checkpoint("expert", k) for k in range(3)),
    "medium-replay": tuple(
        checkpoint("replay", 4 * k + part, policy=k, share=0.25, noise=0.5 - 0.1 * part)
        for k in FRAMES
        for part in range(4)
    ),
    "mixed-conventions": tuple(checkpoint("mixed", k) for k in range(2)),
}


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> Mapping[str, Recipe]:
    """The recipes there would be with checkpoints for `coop_nav` and `formation-n8`."""
    table = {"coop_nav": INDEX, "formation-n8": {"expert": INDEX["expert"]}}

    def found(family: str, tier: str) -> tuple[Checkpoint, ...]:
        return table.get(STRICT_FAMILIES.get(family, family), {}).get(tier, ())

    monkeypatch.setattr(recipes, "checkpoints", found)
    monkeypatch.setattr(tiers, "checkpoint_index", lambda: table)
    monkeypatch.setattr(recipes, "outlines", tiers.outlines.__wrapped__)
    return shipped_recipes.__wrapped__()


def test_without_version_means_the_newest() -> None:
    assert find_recipe("coop_nav-random") is find_recipe("coop_nav-random-v1")
    assert is_dataset("coop_nav-random")
    assert is_dataset("formation-n8-scripted-mini")
    assert not is_dataset("random")


def test_unknown_id_or_version() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'coop_nav-random'"):
        find_recipe("coop_nav-random-v7")


def test_every_tier_has_a_mini_of_the_same_episodes(trained: Mapping[str, Recipe]) -> None:
    names = {f"coop_nav-{name}" for name in TIERS if name != "two-conventions"}
    names |= {f"{family}-{name}" for family in LEARNED_FAMILIES for name in ("random", "scripted")}
    names -= {"pursuit-scripted"}  # its controller is slow
    names |= {f"{family}-two-conventions" for family in CONVENTION_FAMILIES}
    names |= {"formation-n8-expert", "coop_nav-strict-expert", "coop_nav-strict-medium-replay"}
    assert set(trained) == {f"{n}{s}-v1" for n in names for s in ("", "-mini")}
    for name in names:
        full, mini = trained[f"{name}-v1"], trained[f"{name}-mini-v1"]
        free = {"id", "n_steps", "part_episodes"}  # none of which decides what an episode is
        assert full.model_dump(exclude=free) == mini.model_dump(exclude=free)
        assert mini.n_steps * 20 == full.n_steps == 1_000_000


def test_recipes_are_of_the_spec_of_their_preset(trained: Mapping[str, Recipe]) -> None:
    assert {spec.n_agents for spec in FAMILY_SPECS.values()} == {3, 4, 8, 16}
    for key, recipe in trained.items():
        family = key.removesuffix("-v1").removesuffix("-mini").removesuffix(f"-{recipe.tier}")
        assert recipe.spec == FAMILY_SPECS[family]


def test_no_two_tiers_share_their_episodes(trained: Mapping[str, Recipe]) -> None:
    seeds = {recipe.tier: recipe.seed for recipe in trained.values()}

    assert len(set(seeds.values())) == len(seeds) == len(TIERS)


def test_strict_presets_are_recorded_by_the_policies_of_those_without_the_rule() -> None:
    for name, base in STRICT_FAMILIES.items():
        strict, free = FAMILY_SPECS[name], FAMILY_SPECS[base]
        assert strict.with_updates(on_collision=free.on_collision) == free
        for tier in ("medium-replay", "expert"):
            recipes_of = (find_recipe(f"{each}-{tier}") for each in (name, base))
            assert len({each.policies for each in recipes_of}) == 1


def test_mixture_is_half_and_half(trained: Mapping[str, Recipe]) -> None:
    policies = trained["coop_nav-medium-expert-v1"].policies
    shares = {
        kind: sum(p.share for p in policies if p.label.startswith(kind))
        for kind in ("medium", "expert")
    }

    assert len(policies) == 5
    assert shares["medium"] == shares["expert"]
    assert {policy.noise for policy in policies} == {0.1}


def test_replay_is_in_the_proportion_of_training_with_its_noise(
    trained: Mapping[str, Recipe],
) -> None:
    policies = trained["coop_nav-medium-replay-v1"].policies
    shares = [policy.share for policy in policies]

    assert len({policy.label for policy in policies}) == 8
    assert shares[4:] == [3.0 * share for share in shares[:4]]
    assert len(set(shares[:4])) == 1
    assert [policy.noise for policy in policies[:4]] == pytest.approx([0.5, 0.4, 0.3, 0.2])


def test_replay_without_its_medium_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    table = {**INDEX, "medium": INDEX["medium"][:1]}
    monkeypatch.setattr(recipes, "checkpoints", lambda name, tier: table[tier])
    with pytest.raises(BuildError, match="of run 1 of coop_nav, which has 0 mediums"):
        sources("coop_nav", "medium-replay")


def test_special_tiers_of_coop_nav(trained: Mapping[str, Recipe]) -> None:
    mixed = trained["coop_nav-mixed-conventions-v1"].policies
    (narrow,) = trained["coop_nav-narrow-v1"].policies

    assert [policy.noise for policy in mixed] == [0.05, 0.05]
    assert (narrow.checkpoint, narrow.noise) == ("expert-0.safetensors", 0.02)


@pytest.mark.parametrize("family", CONVENTION_FAMILIES)
def test_half_of_the_teams_follow_each_convention_and_both_are_the_expert(family: str) -> None:
    known = FAMILY_SPECS[family].rules.conventions
    recorded = find_recipe(f"{family}-two-conventions").policies
    assert tuple(each.convention for each in recorded) == known
    assert {(each.name, each.noise, each.share) for each in recorded} == {("scripted", 0.05, 1.0)}
    evaluated = sources(family, "expert", 0.0)
    assert tuple(each.convention for each in evaluated) == known
    assert {each.noise for each in evaluated} == {0.0}
    assert sources(family, "medium") == ()


def test_evaluated_policies_have_no_noise(trained: Mapping[str, Recipe]) -> None:
    assert trained
    for tier in TRAINED_TIERS:
        found = sources("coop_nav", tier, 0.0)
        assert [source.noise for source in found] == [0.0] * len(INDEX[tier])
    assert sources("coop_nav", "scripted")[0].noise == 0.0
    assert sources("warehouse", "expert") == ()


@given(
    shares=st.lists(st.floats(0.01, 10.0), min_size=1, max_size=40),
    n_steps=st.sampled_from([50_000, 1_000_000]),
    family=st.sampled_from(FAMILIES),
)
def test_parts_suit_the_smallest_share(shares: list[float], n_steps: int, family: str) -> None:
    policies = [PolicySource(label=str(k), name="x", share=s) for k, s in enumerate(shares)]
    size = part_size(FAMILY_SPECS[family], policies, n_steps)

    assert size in (4, 8, 16, 32, 64, 128, 256)
    needed = n_steps * min(shares) / sum(shares)
    assert size == 4 or size * FAMILY_SPECS[family].horizon <= needed / 2 + 1e-6


@pytest.mark.parametrize("tier", TRAINED_TIERS)
@pytest.mark.parametrize("family", LEARNED_FAMILIES)
def test_shipped_checkpoints_are_those_of_the_index(family: str, tier: str) -> None:
    for shipped in checkpoints(family, tier):
        assert read_checkpoint(shipped.file, shipped.sha256)


def test_no_file_lies_beside_those_of_the_index() -> None:
    folder = files("swarmdata.behavior_policies") / "checkpoints"
    index = tiers.checkpoint_index()
    files_of = (checkpoints(family, tier) for family in index for tier in index[family])
    known = {each.file for found in files_of for each in found}
    assert {each.name for each in folder.iterdir()} == known | {"index.json"}


def test_a_recipe_is_made_when_it_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    build = recipes._recipe

    def recorded(key: str, *rest: Any) -> Recipe:
        made.append(key)
        return build(key, *rest)

    monkeypatch.setattr(recipes, "_recipe", recorded)
    table = shipped_recipes.__wrapped__()
    assert len(table) > 100
    assert "coop_nav-medium-v1" in table
    assert table["coop_nav-medium-v1"] is table["coop_nav-medium-v1"]
    assert made == ["coop_nav-medium-v1"]
    assert table.get("coop_nav-mediun-v1") is None
