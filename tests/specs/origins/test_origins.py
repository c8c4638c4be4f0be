"""Origins: what a `recipe.json` may hold, and datasets stored with them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError
from swarmdata.specs.origins import parse_origin, task_of
from swarmdata.specs.origins.edit_origin import Edit, Parent
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS
from swarmdata.store.assembly import assemble
from swarmdata.store.parts import write_part
from swarmdata.testing.synthetic import make_episode
from swarmdata.types import END_REASONS, Episode
from tests.interop.conftest import POLICIES, RECORDING, SPEC


def record(length: int, seed: int) -> Episode:
    """An episode of agents that leave, in an environment without events and messages."""
    episode = make_episode(length, seed, n_values=0, n_obstacles=0, n_features=5, n_states=3)
    leaves = np.arange(length) == length // 2
    alive = np.ones((length + 1, 2), dtype=np.bool_)
    alive[1:, 0] = ~np.logical_or.accumulate(leaves)
    return replace(
        episode,
        events=episode.events[..., :0],
        log_probs=episode.log_probs[:, :0],
        end_reason=END_REASONS.index("ended"),
        terminations=np.arange(length) == length - 1,
        truncations=np.zeros(length, dtype=np.bool_),
        alive=alive,
        agent_terminations=np.stack([leaves, np.arange(length) == length - 1], 1),
        agent_truncations=np.zeros((length, 2), dtype=np.bool_),
    )


def test_a_recording_is_stored_with_what_it_has(tmp_path: Path) -> None:
    episodes = [record(3 + k % 3, k) for k in range(20)]
    write_part(tmp_path / "part", episodes)
    order = [(0, k) for k in range(20)]
    assemble(tmp_path / "ds", recipe=RECORDING, parts={0: [tmp_path / "part"]}, order=order)
    dataset = Dataset.open(tmp_path / "ds", verify="full")
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
    write_part(tmp_path / "part", [record(4, k) for k in range(3)])
    parent = Parent(id=RECORDING.id, digest="0" * 64, episodes=(0, 5, 7))
    edit = Edit(
        id="tag_v3-few-v0", tier="edit", spec=SPEC, policies=POLICIES, parents=(parent,),
        operation="filter",
    )  # fmt: skip
    parts, order = {0: [tmp_path / "part"]}, [(0, k) for k in range(3)]
    codes = np.array([2, 0, 1], dtype=np.uint8)
    assemble(tmp_path / "ds", recipe=edit, parts=parts, order=order, splits=codes)
    dataset = Dataset.open(tmp_path / "ds")
    assert dataset.recipe == edit
    assert [SPLITS[code] for code in dataset.episodes.split] == ["test", "train", "validation"]
    for wrong in (None, codes[:2], codes + np.uint8(1)):
        with pytest.raises(SchemaError, match="expected 3 codes below 3"):
            assemble(tmp_path / "no", recipe=edit, parts=parts, order=order, splits=wrong)


def test_parts_with_and_without_optional_arrays_do_not_mix(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="expected one kind"):
        write_part(tmp_path / "part", [record(4, 0), replace(record(4, 1), alive=None)])


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
