import dataclasses
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import (
    BuildError,
    MissingFileError,
    RecipeConflictError,
    SchemaError,
    TruncatedFileError,
)
from swarmdata.store.assembly import assemble
from swarmdata.store.episode_order import merge_order
from swarmdata.store.parts import read_part_table, write_part
from swarmdata.store.split_rule import assign_splits
from swarmdata.store.table import n_steps_of
from swarmdata.testing.synthetic import make_episode, make_recipe, make_streams, write_streams

LENGTHS = [[3, 1, 7, 4, 2, 9, 1, 6], [5, 5, 1, 8, 1, 1, 3, 2]]


def test_part_table_has_lengths_and_returns(tmp_path: Path) -> None:
    episodes = make_streams(LENGTHS)[1]
    write_part(tmp_path / "part", episodes)
    table = read_part_table(tmp_path / "part")
    assert table["length"].tolist() == LENGTHS[1]
    assert table["team_return"].tolist() == [episode.team_return for episode in episodes]
    assert n_steps_of(table, table) == 2 * sum(LENGTHS[1])


def test_a_part_is_written_once(tmp_path: Path) -> None:
    write_part(tmp_path / "part", [make_episode(3, seed=1)])
    write_part(tmp_path / "part", [make_episode(8, seed=2)])
    assert read_part_table(tmp_path / "part")["length"].tolist() == [3]
    assert [path.name for path in tmp_path.iterdir()] == ["part"]


def test_a_part_without_the_table_is_missing(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="absent"):
        read_part_table(tmp_path / "nothing")


@pytest.mark.parametrize("name", ["episodes", "layouts", "rewards"])
def test_a_truncated_part_is_named(tmp_path: Path, name: str) -> None:
    parts = write_streams(tmp_path, make_streams([[4, 4, 4]]))
    file = parts[0][0] / f"{name}.npy"
    file.write_bytes(file.read_bytes()[:-3])
    with pytest.raises(TruncatedFileError, match=name):
        assemble(tmp_path / "ds", recipe=make_recipe(8), parts=parts, order=[(0, 0), (0, 1)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"actions": np.zeros((3, 2, 2))}, "dtype float32"),
        ({"policy": 1}, "mixes policies"),
        ({"rewards": np.zeros((3, 7), np.float32)}, "one kind"),
    ],
)
def test_a_part_refuses_what_does_not_fit(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    good = make_episode(3, seed=1)
    bad = dataclasses.replace(good, **change)  # type: ignore[arg-type]
    with pytest.raises(SchemaError, match=message):
        write_part(tmp_path / "part", [good, bad])
    assert not (tmp_path / "part").exists()


def test_a_part_refuses_no_episodes_and_unpaired_contacts(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="no episodes"):
        write_part(tmp_path / "part", [])
    episode = make_episode(3, seed=1)
    episode.events[0, 0, 2] ^= 1
    with pytest.raises(SchemaError, match="even number"):
        write_part(tmp_path / "part", [episode])


@pytest.mark.parametrize(
    "order", [[], [(0, 0), (0, 0)], [(0, 1), (0, 0)], [(0, 99)], [(2, 0)], [(0, -1)]]
)
def test_impossible_orders_are_refused(tmp_path: Path, order: list[tuple[int, int]]) -> None:
    parts = write_streams(tmp_path, make_streams(LENGTHS))
    with pytest.raises(SchemaError, match="order"):
        assemble(tmp_path / "ds", recipe=make_recipe(8, 2), parts=parts, order=order)
    assert not (tmp_path / "ds").exists()


def test_parts_of_another_policy_are_refused(tmp_path: Path) -> None:
    parts = write_streams(tmp_path, make_streams(LENGTHS))
    with pytest.raises(SchemaError, match="other policies"):
        assemble(tmp_path / "ds", recipe=make_recipe(8, 2), parts={0: parts[1]}, order=[(0, 0)])


def test_a_dataset_without_train_episodes_is_refused(tmp_path: Path) -> None:
    parts = write_streams(tmp_path, make_streams([[1] * 10]))
    recipe = make_recipe(1, block=3)
    order = [(0, episode) for episode in range(3)]
    held_out = [one for one, code in zip(order, assign_splits(recipe, order), strict=True) if code]
    assert len(held_out) == 2
    with pytest.raises(BuildError, match="train"):
        assemble(tmp_path / "ds", recipe=recipe, parts=parts, order=held_out)


def test_assembling_again_keeps_the_dataset(tmp_path: Path) -> None:
    recipe = make_recipe(30, n_policies=2)
    parts = write_streams(tmp_path / "parts", make_streams(LENGTHS))
    order = merge_order(recipe, LENGTHS).order
    first = assemble(tmp_path / "ds", recipe=recipe, parts=parts, order=order)
    before = (tmp_path / "ds").stat().st_ino
    assert assemble(tmp_path / "ds", recipe=recipe, parts={}, order=[]) == first
    assert (tmp_path / "ds").stat().st_ino == before
    with pytest.raises(RecipeConflictError, match="another folder"):
        assemble(tmp_path / "ds", recipe=make_recipe(31, 2), parts=parts, order=order)
    (tmp_path / "ds" / "manifest.json").unlink()
    with pytest.raises(BuildError, match="not a finished dataset"):
        assemble(tmp_path / "ds", recipe=recipe, parts=parts, order=order)
