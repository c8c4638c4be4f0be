"""Edits hold exactly the chosen episodes, with splits, seeds and policies; made again, the same."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from swarmdata.building.combine import merge_policies
from swarmdata.building.edit import (
    combine_datasets,
    filter_dataset,
    rebuild_edit,
    subsample_dataset,
)
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    BuildError,
    DatasetNotFoundError,
    RecipeConflictError,
    SchemaError,
    SpecError,
    UnknownNameError,
)
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.record.recorder import Recorder
from swarmdata.registry.presets import preset
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.dataset_contract import check_dataset
from swarmdata.testing.synthetic import make_dataset, make_episode, make_recipe
from swarmdata.types import Bool, Episode
from tests.interop.logs.logged_team import log_map, write_team
from tests.record.worlds import Choosing
from tests.support.made_episodes import left_early, stored
from tests.support.tiny import abandoned

LENGTHS = [[3, 1, 7, 4, 2, 9, 1, 6, 5, 5, 3, 8], [5, 5, 1, 8, 1, 1, 3, 2, 6, 4, 7, 2]]


def make(folder: Path, first_seed: int = 0, **recipe: object) -> Dataset:
    """Twelve episodes of each of two policies, with consecutive seeds."""
    streams = [
        [make_episode(n, first_seed + 12 * p + k, p) for k, n in enumerate(LENGTHS[p])]
        for p in range(2)
    ]
    return stored(folder, make_recipe(40, n_policies=2).model_copy(update=recipe), streams)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make(tmp_path_factory.mktemp("editing") / "source")


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("editing") / "other"
    policies = (
        PolicySource(label="tag-0", name="random", share=5.0),  # the same but for its share
        PolicySource(label="tag-1", name="straight"),  # another under the same label
    )
    return make(folder, 100, id="coop_nav-other-v0", policies=policies)


def assert_same(got: Episode, expected: Episode) -> None:
    for name in (*Episode.__dataclass_fields__,):
        if name != "policy":
            np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_filter_holds_exactly_the_view(source: Dataset, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in source.path.rglob("*") if p.is_file()}
    made = filter_dataset(source, tmp_path / "out", id="coop_nav-good-v0", min_return=-1.0)
    view = source.filter(min_return=-1.0)
    assert 0 < len(made) == len(view) < len(source)
    for got, expected in zip(made, view, strict=True):
        assert_same(got, expected)
    for name in ("seeds", "split", "team_return", "robot_collisions", "end_reason"):
        ours, theirs = getattr(made.episodes, name), getattr(view.episodes, name)
        np.testing.assert_array_equal(ours, theirs)
    assert isinstance(made.recipe, Edit)
    (parent,) = made.recipe.parents
    assert (parent.id, parent.digest) == (source.id, source.digest)
    assert parent.episodes == tuple(view.selection.tolist())
    assert made.recipe.operation == "filter(min_return=-1.0)"
    assert made.recipe.spec == source.recipe.spec
    check_dataset(tmp_path / "out")
    assert before == {p: p.read_bytes() for p in source.path.rglob("*") if p.is_file()}


def test_filter_by_every_condition(source: Dataset, tmp_path: Path) -> None:
    table = source.episodes
    seeds = [int(s) for s in table.seeds[:5]]
    cases: dict[str, tuple[dict[str, Any], Bool]] = {
        "success": ({"success": False}, ~table.success),
        "policy": ({"policy": "tag-1"}, table.policy == 1),
        "split": ({"split": "train"}, table.split == 0),
        "range": ({"max_return": 2.0, "min_return": -5.0}, np.abs(table.team_return + 1.5) <= 3.5),
        "seeds": ({"seeds": seeds}, np.isin(table.seeds, seeds)),
        "episodes": ({"episodes": [1, 3, 4]}, np.isin(np.arange(len(table)), [1, 3, 4])),
        "mask": ({"episodes": table.lengths > 3}, table.lengths > 3),
    }
    for name, (conditions, mask) in cases.items():
        made = filter_dataset(source, tmp_path / name, id="coop_nav-some-v0", **conditions)
        np.testing.assert_array_equal(made.episodes.seeds, table.seeds[mask], name)
        labels = {p.label for p in made.recipe.policies}
        assert labels == {f"tag-{k}" for k in np.unique(table.policy[mask])}  # those that acted


def test_numbers_of_episodes_are_those_of_the_view(source: Dataset, tmp_path: Path) -> None:
    view = source.split("train")
    chosen = [row.index for row in view.episodes][2:9:3]
    made = filter_dataset(view, tmp_path / "out", id="coop_nav-some-v0", episodes=chosen)
    assert [e.seed for e in made] == [view[number].seed for number in chosen]


def test_filter_refuses_what_is_not_there(source: Dataset, tmp_path: Path) -> None:
    out, least = tmp_path / "out", source.episodes.team_return.min()
    cases: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"seeds": [0, 99999]}, SchemaError, r"seeds of .*synthetic-v0 \[99999\] are not there"),
        ({"episodes": [500]}, SchemaError, r"episodes of .* \[500\] are not there"),
        ({"policy": "tag-2"}, UnknownNameError, "tag-1"),
        ({"min_return": 1e9}, BuildError, f"conditions; their team returns are {least:.6g} to"),
        ({"split": "test"}, BuildError, "none of the episodes is in the train split"),
        ({"success": False, "id": "../coop_nav"}, SpecError, "invalid Edit"),
    ]
    for conditions, error, message in cases:
        with pytest.raises(error, match=message):
            filter_dataset(source, out, **{"id": "coop_nav-some-v0", **conditions})
    assert not out.exists()


def test_combine_of_views_holds_exactly_the_views(
    source: Dataset, other: Dataset, tmp_path: Path
) -> None:
    """Minari's combination takes all episodes of a filtered dataset, and drops their seeds."""
    views = [source.filter(policy="tag-1"), other.split("train")]
    made = combine_datasets(views, tmp_path / "out", id="coop_nav-both-v0")
    assert len(made) == len(views[0]) + len(views[1])
    for got, expected in zip(made, [*views[0], *views[1]], strict=True):
        assert_same(got, expected)
    check_dataset(tmp_path / "out")


def test_policies_are_merged_or_renamed(source: Dataset, other: Dataset, tmp_path: Path) -> None:
    made = combine_datasets([source, other], tmp_path / "out", id="coop_nav-both-v0")
    labels = [policy.label for policy in made.recipe.policies]
    assert labels == ["tag-0", "tag-1", "coop_nav-other-v0/tag-1"]
    assert [p.name for p in made.recipe.policies] == ["random", "random", "straight"]
    first, second = made.episodes.policy[: len(source)], made.episodes.policy[len(source) :]
    np.testing.assert_array_equal(first, source.episodes.policy)
    np.testing.assert_array_equal(second, np.array([0, 2])[other.episodes.policy])
    for policy in range(3):  # streams are counted anew
        stream = made.episodes.policy_episode[made.episodes.policy == policy]
        np.testing.assert_array_equal(stream, np.arange(len(stream)))
    assert len(made.filter(policy="coop_nav-other-v0/tag-1")) == int((second == 2).sum())


def test_three_policies_of_one_label(source: Dataset, other: Dataset) -> None:
    noisy = tuple(p.model_copy(update={"noise": 0.5}) for p in other.recipe.policies)
    recipe = other.recipe.model_copy(update={"policies": noisy})
    again = replace(other, stored=replace(other.stored, recipe=recipe))
    policies, maps = merge_policies([source, other, again])
    assert [p.label for p in policies] == [
        "tag-0", "tag-1", "coop_nav-other-v0/tag-1", "coop_nav-other-v0/tag-0",
        "coop_nav-other-v0/tag-1-2",
    ]  # fmt: skip
    assert maps == [{0: 0, 1: 1}, {0: 0, 1: 2}, {0: 3, 1: 4}]


def test_combine_refuses_other_specs(source: Dataset, tmp_path: Path) -> None:
    spec = source.task.with_updates(horizon=77)
    later = make(tmp_path / "later", 100, spec=spec)
    with pytest.raises(SpecError, match="different specs: horizon is 160 and 77"):
        combine_datasets([source, later], tmp_path / "out", id="coop_nav-both-v0")
    formation = TaskSpec.parse({**spec.model_dump(), "rules": {"task": "formation"}})
    task = make(tmp_path / "task", 100, spec=formation)
    with pytest.raises(SpecError, match="task is 'coop_nav' and 'formation'"):
        combine_datasets([source, task], tmp_path / "out", id="coop_nav-both-v0")
    with pytest.raises(SchemaError, match="expected at least 1"):
        combine_datasets([], tmp_path / "out", id="coop_nav-both-v0")


def test_combine_refuses_an_episode_twice(source: Dataset, tmp_path: Path) -> None:
    fourth = int(np.flatnonzero(source.episodes.split == 0)[4])
    seed = int(source.episodes.seeds[fourth])
    views = [source.filter(policy="tag-0"), source]
    with pytest.raises(SchemaError, match=r"have the same seed or parent, \d+ pairs in all"):
        combine_datasets(views, tmp_path / "out", id="coop_nav-both-v0")
    apart = [
        filter_dataset(source, tmp_path / "one", id="coop_nav-one-v0", seeds=[seed]),
        filter_dataset(source, tmp_path / "all", id="coop_nav-all-v0"),
    ]
    message = f"episode 0 of coop_nav-one-v0 and episode {fourth} of coop_nav-all-v0"
    with pytest.raises(SchemaError, match=message):
        combine_datasets(apart, tmp_path / "out", id="coop_nav-both-v0")


def test_same_request_is_kept_and_another_refused(source: Dataset, tmp_path: Path) -> None:
    made = filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-0")
    inode = (tmp_path / "out/manifest.json").stat().st_ino
    again = filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-0")
    assert again.digest == made.digest
    assert (tmp_path / "out/manifest.json").stat().st_ino == inode
    with pytest.raises(RecipeConflictError, match="coop_nav-some-v0"):
        filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-1")


def test_killed_in_the_middle_leaves_nothing(
    source: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    abandoned(tmp_path / "out")
    others = abandoned(tmp_path / "out-more")
    with monkeypatch.context() as patch:
        full = OSError("no space left on device")
        patch.setattr("swarmdata.store.assembly.create_metadata", Mock(side_effect=full))
        with pytest.raises(OSError, match="no space"):
            filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-0")
    assert [p.name for p in tmp_path.iterdir()] == [others.name]
    made = filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-0")
    assert made.digest == Dataset.open(tmp_path / "out", verify="full").digest


def test_an_edit_in_the_cache_has_no_published_id(source: Dataset, tmp_path: Path) -> None:
    taken: dict[str, Any] = {"id": "coop_nav-medium-v1", "policy": "tag-0"}
    with pytest.raises(SpecError, match="is the id of a dataset of the package"):
        filter_dataset(source, **taken)
    assert filter_dataset(source, tmp_path / "out", **taken).id == "coop_nav-medium-v1"


def test_edits_of_edits_are_made_again(source: Dataset, other: Dataset, tmp_path: Path) -> None:
    both = combine_datasets([source, other], tmp_path / "both", id="coop_nav-both-v0")
    few = subsample_dataset(both, tmp_path / "few", id="coop_nav-few-v0", n_steps=40, seed=3)
    for made, parents in ((both, [other, source]), (few, [source, both])):
        assert isinstance(made.recipe, Edit)
        again = rebuild_edit(made.recipe, parents, tmp_path / f"{made.path.name}-again")
        assert again.digest == made.digest
        assert again.recipe == made.recipe
    assert isinstance(few.recipe, Edit)
    with pytest.raises(DatasetNotFoundError, match="is made from coop_nav-both-v0 with digest"):
        rebuild_edit(few.recipe, [source], tmp_path / "no")


def test_an_edit_that_does_not_fit_its_parents_is_refused(source: Dataset, tmp_path: Path) -> None:
    edit = filter_dataset(source, tmp_path / "out", id="coop_nav-some-v0", policy="tag-0").recipe
    assert isinstance(edit, Edit)
    renamed = (edit.policies[0].model_copy(update={"label": "best"}),)
    with pytest.raises(SchemaError, match=r"policies\[0\].label is 'best', not 'tag-0'"):
        rebuild_edit(edit.model_copy(update={"policies": renamed}), [source], tmp_path / "no")
    parent = edit.parents[0].model_copy(update={"episodes": (0, 999)})
    with pytest.raises(SchemaError, match=r"\[999\] are not there"):
        rebuild_edit(edit.model_copy(update={"parents": (parent,)}), [source], tmp_path / "no")


def test_subsample_to_a_size_a_range_and_a_distribution(source: Dataset, tmp_path: Path) -> None:
    small = subsample_dataset(source, tmp_path / "small", id="coop_nav-small-v0", n_steps=20)
    assert 20 <= small.n_steps < 20 + 9
    assert small.recipe.operation == "subsample(n_steps=20, seed=0)"  # type: ignore[attr-defined]
    ranged = subsample_dataset(
        source, tmp_path / "ranged", id="coop_nav-ranged-v0", min_return=-2.0, max_return=2.0
    )
    view = source.filter(min_return=-2.0, max_return=2.0)
    np.testing.assert_array_equal(ranged.episodes.seeds, view.episodes.seeds)
    target = source.filter(policy="tag-0")
    like = subsample_dataset(source, tmp_path / "like", id="coop_nav-like-v0", like=target, bins=2)
    assert f"like={source.id} ({len(target)} episodes, digest" in like.recipe.operation  # type: ignore[attr-defined]
    with pytest.raises(SchemaError, match="asked for nothing"):
        subsample_dataset(source, tmp_path / "no", id="coop_nav-no-v0")


def test_reobservations_are_refused(tmp_path: Path, record: Callable[..., Path]) -> None:
    spec = preset("coop_nav").with_updates(horizon=5)
    source = Dataset.open(record(tmp_path / "source", spec, ("random",)))
    view = source.reobserve("lidar", progress=False)
    with pytest.raises(SpecError, match="reobservation"):
        combine_datasets([view], tmp_path / "out", id="coop_nav-seen-v0")


def test_shapes_that_do_not_fit_are_named(source: Dataset, tmp_path: Path) -> None:
    make_dataset(tmp_path / "same", [[4] * 12])
    same = Dataset.open(tmp_path / "same")
    stored = replace(
        same.stored, arrays={**same.stored.arrays, "sent": np.zeros((60, 2, 1), np.float32)}
    )
    seeds = replace(stored.table, seeds=stored.table.seeds + np.uint64(500))
    apart = replace(same, stored=replace(stored, table=seeds))
    with pytest.raises(SchemaError, match="do not fit together: one has other rows of sent"):
        combine_datasets([source, apart], tmp_path / "out", id="coop_nav-both-v0")


def test_teams_that_agents_leave_are_combined_with_whole_ones(
    source: Dataset, tmp_path: Path
) -> None:
    leaving = [left_early(make_episode(6, 900 + k)) for k in range(12)]
    recipe = make_recipe(40).model_copy(update={"id": "coop_nav-leaving-v0"})
    left = stored(tmp_path / "left", recipe, [leaving])
    for parts in ([source, left], [left, source]):
        both = combine_datasets(parts, tmp_path / parts[0].id, id="coop_nav-both-v0")
        check_dataset(both.path)
        for got, expected in zip(both, [e for part in parts for e in part], strict=True):
            n = expected.rewards.shape[1]
            if expected.alive is not None:
                np.testing.assert_array_equal(got.alive, expected.alive)
                continue
            acts = np.arange(len(expected.rewards) + 1)[:, None] < len(expected.rewards)
            np.testing.assert_array_equal(got.alive, np.repeat(acts, n, axis=1))
            for name in ("terminations", "truncations"):
                of_team = np.repeat(getattr(expected, name)[:, None], n, axis=1)
                np.testing.assert_array_equal(getattr(got, f"agent_{name}"), of_team)


def test_recordings_with_action_masks_are_combined_with_those_without(tmp_path: Path) -> None:
    """They were refused, although without masks every choice is allowed."""
    both = []
    for name, mask_in in (("masked", "info"), ("free", None), ("freer", None)):
        path, made = tmp_path / name, f"choosing_v2-{name}-v0"
        with Recorder(Choosing(mask_in), id=made, path=path) as recorder:
            for _ in range(10):
                recorder.reset()
                while recorder.agents:
                    recorder.step({a: recorder.action_space(a).sample() for a in recorder.agents})
        both.append(recorder.close())
    combined = combine_datasets(both[1::-1], tmp_path / "both", id="choosing_v2-both-v0")
    free, masked = combined[0].action_masks, both[0][0].action_masks
    assert free is not None
    assert masked is not None
    exist = masked.copy()
    exist[:-1, 0, :3] = True  # the agent with a mask has three choices
    np.testing.assert_array_equal(free, exist)
    np.testing.assert_array_equal(combined[10].action_masks, masked)
    all_three = combine_datasets(both[::-1], tmp_path / "all", id="choosing_v2-all-v0")
    np.testing.assert_array_equal(all_three[20].action_masks, masked)  # only the last one has some


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        ({"n_steps": 20, "seed": -1}, "seed is -1"),
        ({"n_steps": 20, "seed": 1.5}, "seed is 1.5"),
        ({"n_steps": 20, "seed": None}, "seed is None"),
        ({"n_steps": float("nan")}, "n_steps is nan"),  # it kept all episodes
        ({"n_steps": 20, "bins": 4}, "bins is 4, which are only for `like`"),
        ({"like": [1.0]}, "like is"),
        ({"n_steps": 20, "out": 3}, "out is 3"),
    ],
)
def test_what_subsample_cannot_use_is_refused(
    source: Dataset, tmp_path: Path, given: dict[str, Any], wrong: str
) -> None:
    with pytest.raises(SchemaError, match=wrong):
        subsample_dataset(source, **{"out": tmp_path / "out", "id": "coop_nav-few-v0", **given})


@pytest.mark.parametrize("given", [{"episodes": 3}, {"seeds": 3}, {"seeds": map(int, "12")}])
def test_episodes_and_seeds_are_collections(
    source: Dataset, tmp_path: Path, given: dict[str, Any]
) -> None:
    """Of an iterator, the check read all seeds, so that none were left to select."""
    with pytest.raises(SchemaError, match=f"{next(iter(given))} are .*, expected"):
        filter_dataset(source, tmp_path / "out", id="coop_nav-few-v0", **given)


def test_imported_logs_are_combined_and_keep_their_episodes_apart(tmp_path: Path) -> None:
    """Their seeds number the episodes from 0, so that two days were taken for the same episodes."""
    days = []
    for name, seconds in (("monday", 30.0), ("tuesday", 40.0), ("wednesday", 30.5)):
        folder, cuts = tmp_path / name, log_map(episodes={"length": 1.0})
        folder.mkdir()
        logs = write_team(folder, seconds)
        days.append(import_logs(logs, folder / "ds", log_map=cuts, id=f"hall-{name}-v0"))
    both = combine_datasets(days[:2], tmp_path / "both", id="hall-both-v0")
    for got, expected in zip(both, [*days[0], *days[1]], strict=True):
        np.testing.assert_array_equal(got.actions, expected.actions)
    assert len(np.unique(both.episodes.seeds)) == len(both)
    assert isinstance(both.recipe, Edit)
    assert rebuild_edit(both.recipe, days, tmp_path / "again").digest == both.digest
    whole = combine_datasets([both, days[2]], tmp_path / "whole", id="hall-whole-v0")
    part = filter_dataset(days[0], tmp_path / "part", id="hall-part-v0")
    for twice in ([days[0], days[0]], [both, days[1][3:]], [whole, days[0]], [both, part]):
        with pytest.raises(SchemaError, match="have the same seed"):
            combine_datasets(twice, tmp_path / "out", id="hall-twice-v0")
