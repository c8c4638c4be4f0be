"""World version 0 is read and not simulated; its ids are refused and mean nothing else."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.behavior_policies.tiers import find_recipe, is_dataset, shipped_recipes
from swarmdata.errors import ReplacedDatasetError, SpecError, UnknownNameError
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.replaced_worlds import REPLACED_IDS, check_world, refuse_replaced
from swarmdata.specs.model_choice import is_same_world
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.task_spec import WORLD_VERSION, TaskSpec


def test_ids_have_the_version_of_their_world() -> None:
    for key, recipe in shipped_recipes().items():
        assert key == recipe.id == f"{without_version(key)}-v{recipe.spec.version}"
        assert recipe.spec.version == WORLD_VERSION == 1


def test_the_ids_of_version_0_are_those_that_were_shipped() -> None:
    assert len(REPLACED_IDS) == 76
    some = {"coop_nav-medium-v0", "coop_nav-narrow-mini-v0", "formation-n8-expert-v0"}
    assert some < REPLACED_IDS
    assert not REPLACED_IDS & set(shipped_recipes())


@pytest.mark.parametrize("name", sorted(REPLACED_IDS))
def test_an_id_of_version_0_is_one_sentence_and_nothing_else(name: str) -> None:
    assert not is_dataset(name)
    with pytest.raises(ReplacedDatasetError) as caught:
        find_recipe(name)
    message = str(caught.value)
    assert message.startswith(f"{name} was replaced by {without_version(name)}-v1, because ")
    assert "swarmdata 0.1 (commit 7a313a1 of the repository)" in message
    assert f"`swarmdata pull {name} --from ADDRESS`" in message
    assert "\n" not in message
    assert isinstance(caught.value, UnknownNameError)


@given(st.from_regex(r"[a-z_]{1,9}(-[a-z0-9_]{1,9}){1,3}-v[0-9]{1,3}", fullmatch=True))
def test_other_ids_pass(name: str) -> None:
    refuse_replaced(name)
    assert without_version(name) == name[: name.rindex("-v")]


@pytest.mark.parametrize("name", preset_names())
def test_presets_of_version_0_are_described_and_not_simulated(name: str) -> None:
    spec = preset(name)
    old = spec.with_updates(version=0)
    check_world(spec)
    assert make_task(old).terms == make_task(spec).terms
    assert TaskSpec.from_text(old.to_json()) == old
    with pytest.raises(SpecError, match=re.escape("swarmdata 0.1 (commit 7a313a1")) as caught:
        make_env(old)
    assert str(caught.value).startswith("world version 0 was simulated by")
    assert "this one simulates version 1" in str(caught.value)


def test_a_world_without_a_version_is_the_current_one() -> None:
    assert TaskSpec().version == WORLD_VERSION
    assert TaskSpec.from_text("horizon: 9").version == WORLD_VERSION


@given(st.integers(WORLD_VERSION + 1, 10**12))
def test_a_newer_world_asks_for_an_upgrade(version: int) -> None:
    with pytest.raises(SpecError, match="was made by a newer swarmdata") as caught:
        TaskSpec.parse({"version": version})
    assert f"world version {version} was" in str(caught.value)
    assert "pip install --upgrade swarmdata" in str(caught.value)


@pytest.mark.parametrize("name", preset_names())
def test_worlds_of_two_versions_share_no_score(name: str) -> None:
    spec = preset(name)
    old = spec.with_updates(version=0)
    assert spec.hash() != old.hash()
    assert not is_same_world(spec, old)
