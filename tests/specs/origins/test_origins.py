"""Origins: what a `recipe.json` may hold, and datasets stored with them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SchemaError, SpecError
from swarmdata.specs.origins import parse_origin, task_of
from swarmdata.specs.origins.edit_origin import Edit, Parent
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS, open_store
from swarmdata.store.parts import write_part
from swarmdata.types import END_REASONS
from tests.interop.conftest import POLICIES, RECORDING, SPEC, recorded_episodes
from tests.support.made_episodes import stored


def test_a_recording_is_stored_with_what_it_has(tmp_path: Path) -> None:
    lengths = [3, 4, 5, 2] * 5
    episodes = [replace(each, action_masks=None) for each in recorded_episodes(lengths)]
    dataset = stored(tmp_path / "ds", RECORDING, [episodes])
    open_store(dataset.path, "full")
    assert dataset.recipe == RECORDING
    assert dataset.spec == SPEC
    assert sorted(np.unique(dataset.episodes.split)) == [0, 1, 2]
    for got, expected in zip(dataset, episodes, strict=True):
        assert got.optional == ("alive", "agent_terminations", "agent_truncations")
        for name in ("observations", "events", "log_probs", *got.optional):
            np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    attributes = json.loads((tmp_path / "ds/data.zarr/zarr.json").read_text())["attributes"]
    assert attributes["end_reasons"] == list(END_REASONS)
    with pytest.raises(SpecError, match=r"recorded in tag_v3.* needs a task of swarmdata"):
        _ = dataset.task


def test_an_edit_keeps_the_splits_it_is_given(tmp_path: Path) -> None:
    streams = [recorded_episodes([4, 4, 4])]
    parent = Parent(id=RECORDING.id, digest="0" * 64, episodes=(0, 5, 7))
    edit = Edit(
        id="tag_v3-few-v0", tier="edit", spec=SPEC, policies=POLICIES, parents=(parent,),
        operation="filter",
    )  # fmt: skip
    codes = np.array([2, 0, 1], dtype=np.uint8)
    dataset = stored(tmp_path / "ds", edit, streams, codes)
    assert dataset.recipe == edit
    assert [SPLITS[code] for code in dataset.episodes.split] == ["test", "train", "validation"]
    for wrong in (None, codes[:2], codes + np.uint8(1)):
        with pytest.raises(SchemaError, match="expected 3 codes below 3"):
            stored(tmp_path / "no", edit, streams, wrong)


def test_parts_with_and_without_optional_arrays_do_not_mix(tmp_path: Path) -> None:
    first, second = recorded_episodes([4, 4])
    with pytest.raises(SchemaError, match="expected one kind"):
        write_part(tmp_path / "part", [first, replace(second, alive=None)])


def test_an_origin_without_kind_is_a_recipe() -> None:
    recipe = Recipe(id="coop_nav-mine-v0", tier="mine", spec=TaskSpec(), policies=POLICIES)
    assert parse_origin(json.loads(recipe.to_json()), "recipe.json") == recipe
    assert parse_origin(json.loads(RECORDING.to_json()), "recipe.json") == RECORDING
    ours = RECORDING.model_copy(update={"spec": TaskSpec()})
    assert parse_origin(json.loads(ours.to_json()), "recipe.json") == ours
    assert task_of(ours, "this") == TaskSpec()
    assert RECORDING.split_rule is not None
    assert RECORDING.model_copy(update={"splits": None}).split_rule is None
    with pytest.raises(SpecError, match="invalid Recipe in x"):
        parse_origin({"kind": "nothing"}, "x")
