"""Data of others are understood, or refused before anything is written."""

import datetime
import decimal
import os
from collections.abc import Callable
from functools import partial
from operator import setitem
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from gymnasium import spaces

from swarmdata.audit import audit
from swarmdata.cards.side_files import damage_of
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SchemaError, SwarmdataError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.specs.spaces import DiscreteSpace, MultiDiscreteSpace
from swarmdata.store.damage import find_damage
from swarmdata.types import END_REASONS
from tests.interop.foreign import WRITERS, TakeIn, hdf5, numpy_folder, parquet, team, write_minari

pyarrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
pq = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")


def convert(source: Path, kind: str, **answers: Any) -> Dataset:
    return import_dataset(source, source.parent / "out", format=kind, id="maze-x-v0", **answers)


def refused(source: Path, kind: str, words: str, **answers: Any) -> None:
    """One error of ours, and nothing at the destination."""
    before = {path.name for path in source.parent.iterdir()}
    with pytest.raises(SwarmdataError, match=words) as caught:
        convert(source, kind, **answers)
    assert isinstance(caught.value, ConversionError | SchemaError)
    assert {path.name for path in source.parent.iterdir()} - before <= {".out.lock"}


# ------------------------------------------------------------------ ends


@pytest.mark.parametrize("stays_set", [False, True])
def test_flags_that_are_set_once_end_an_episode_when_all_have_one(
    tmp_path: Path, take_in: TakeIn, stays_set: bool
) -> None:
    arrays = team(40)
    arrays["timeouts"][:] = False
    for start in (0, 20):
        arrays["terminals"][start + 10, 0] = arrays["terminals"][start + 19, 1] = True
        if stays_set:
            arrays["terminals"][start + 10 : start + 20, 0] = True
    taken = take_in(hdf5(tmp_path / "x.hdf5", arrays), "d4rl", time_limit=0)
    assert taken.lengths == [20, 20]
    assert taken.ends == ["ended", "ended"]
    for episode in taken.episodes:
        assert episode.alive[:, 0].tolist() == [True] * 11 + [False] * 10
        assert episode.alive[:, 1].tolist() == [True] * 20 + [False]
        assert np.argwhere(episode.agent_terminations).tolist() == [[10, 0], [19, 1]]


def test_an_episode_is_truncated_if_an_agent_is_in_its_last_step(
    tmp_path: Path, take_in: TakeIn
) -> None:
    arrays = team(10, length=5)
    arrays["timeouts"][:] = False
    arrays["timeouts"][2, 0] = arrays["terminals"][4, 1] = True  # cut early, the team terminates
    arrays["terminals"][6, 0] = arrays["timeouts"][9, 1] = True
    taken = take_in(hdf5(tmp_path / "x.hdf5", arrays), "d4rl")
    assert taken.ends == ["ended", "horizon"]
    assert np.argwhere(taken.episodes[0].agent_truncations).tolist() == [[2, 0]]
    assert np.argwhere(taken.episodes[1].agent_truncations).tolist() == [[4, 1]]


def test_terminations_wherever_there_are_truncations_are_asked_about(
    tmp_path: Path, take_in: TakeIn
) -> None:
    arrays = team(20, length=5)
    arrays["terminals"] |= arrays["timeouts"]
    source = hdf5(tmp_path / "x.hdf5", arrays)
    refused(source, "d4rl", "has a termination wherever it has a truncation")
    assert take_in(source, "d4rl", time_limit=0).ends == ["ended"] * 4
    assert take_in(source, "d4rl", time_limit=5).ends == ["horizon"] * 4


def test_data_without_any_flag_are_one_open_episode(tmp_path: Path, take_in: TakeIn) -> None:
    arrays = team(60)
    arrays["timeouts"][:] = False
    source = hdf5(tmp_path / "x.hdf5", arrays)
    refused(source, "d4rl", "has 60 rows from row 0 on without an end")
    refused(source, "d4rl", "has no whole episode", unfinished="drop")
    taken = take_in(source, "d4rl", unfinished="truncate")
    assert (taken.lengths, taken.ends) == ([60], ["horizon"])


def test_a_limit_below_the_lengths_is_refused(tmp_path: Path) -> None:
    source = hdf5(tmp_path / "x.hdf5", team(60, length=5))
    refused(source, "d4rl", "5 steps in rows 0 to 4, longer than time_limit=3", time_limit=3)


def test_episodes_that_a_cut_leaves_empty_are_counted(tmp_path: Path, take_in: TakeIn) -> None:
    arrays = team(60, length=5)
    arrays["timeouts"][55] = True  # an episode of one step, and one of four
    del arrays["next_observations"]
    taken = take_in(hdf5(tmp_path / "x.hdf5", arrays), "d4rl", final="cut")
    assert taken.lengths == [4] * 11 + [3]
    assert taken.metadata["dropped_rows"] == "13", "one of each episode, the short one included"
    for episode in taken.episodes:
        assert episode.observations[-1, 0, 0] - episode.observations[0, 0, 0] == len(episode)


# ------------------------------------------------------------------ spaces and numbers


@pytest.mark.parametrize("kind", WRITERS)
def test_whole_numbers_are_choices_each(tmp_path: Path, kind: str, take_in: TakeIn) -> None:
    arrays = team(60, n_agents=1)
    pairs = np.stack([np.arange(60) % 3, np.arange(60) % 2], 1)
    arrays["actions"] = pairs[:, None] if kind == "numpy" else pairs
    dataset = convert(WRITERS[kind](tmp_path / "x", arrays), kind, time_limit=5)
    assert dataset.spec.action_spaces == (MultiDiscreteSpace(n=(3, 2)),)
    np.testing.assert_array_equal(dataset.transitions()["actions"][:, 0], pairs)
    assert Dataset.open(dataset.path, "full").digest == dataset.digest
    arrays["actions"] = arrays["actions"][..., :1]
    one = take_in(WRITERS[kind](tmp_path / "one", arrays), kind, time_limit=5)
    assert one.spec.action_spaces == (DiscreteSpace(n=3),)


@pytest.mark.parametrize(
    ("kind", "name", "values", "words"),
    [
        ("d4rl", "observations", np.int64(1 << 40), "above 16777216"),
        ("d4rl", "actions", np.int64(-1), "expected choices, counted from 0"),
        ("d4rl", "rewards", 1e39, "rewards is not finite"),
        ("numpy", "observations", 1.7e9 + 0.25, "above 16777216"),
        ("numpy", "actions", np.int64(1 << 40), "below 16777216"),
        ("parquet", "next_observations", np.nan, "next_observations is not finite"),
        ("parquet", "rewards", 1.7e9 + 0.25, "above 16777216"),
    ],
)
def test_what_float32_does_not_hold_is_refused_by_every_reader(
    tmp_path: Path, kind: str, name: str, values: Any, words: str
) -> None:
    arrays = team(60)
    arrays[name] = arrays[name].astype(np.asarray(values).dtype)
    arrays[name][7] = values
    refused(WRITERS[kind](tmp_path / "x", arrays), kind, words, time_limit=5)


def test_complex_rewards_and_odd_flags_are_refused(tmp_path: Path) -> None:
    arrays = team(60)
    for k, (changes, words) in enumerate((
        ({"rewards": arrays["rewards"] + 1j}, "Dataset of type complex64 at 'rewards', expected"),
        ({"terminals": np.full(60, 2)}, "terminals has the value 2, expected flags: 0 or 1"),
        ({"rewards": np.zeros((60, 3))}, "expected one value, or one for each of 2 agents"),
        ({"next_observations": np.zeros((60, 2, 3))}, "next_observations has rows of shape"),
        ({name: each[:0] for name, each in arrays.items()}, "has no rows"),
    )):  # fmt: skip
        refused(hdf5(tmp_path / f"{k}.hdf5", {**arrays, **changes}), "d4rl", words)


def test_actions_outside_the_bounds_that_the_user_says_are_refused(tmp_path: Path) -> None:
    source = hdf5(tmp_path / "x.hdf5", team(60))
    refused(source, "d4rl", "bounds: action .* is not in its space, expected a value from 0 to 0.5",
            action_low=0.0, action_high=0.5)  # fmt: skip
    assert convert(source, "d4rl", action_low=0.0, action_high=1.0).n_steps == 60


@pytest.mark.parametrize(
    "value",
    ["a", {"a": 1.0}, decimal.Decimal("1.5"), datetime.timedelta(1)],
    ids=lambda value: type(value).__name__,
)
def test_columns_that_are_no_numbers_are_refused(tmp_path: Path, value: Any) -> None:
    table = pq.read_table(parquet(tmp_path / "a.parquet", team(60)))
    odd = pyarrow.array([[value]] * 60)
    table = table.set_column(table.schema.get_field_index("actions"), "actions", odd)
    pq.write_table(table, tmp_path / "x.parquet")
    refused(tmp_path / "x.parquet", "parquet", "column 'actions' is of type .* expected numbers")


def test_arrays_that_nothing_takes_are_named(tmp_path: Path) -> None:
    arrays = team(60) | {"costs": np.zeros(60), "infos/action_log_probs": np.zeros(60)}
    dataset = convert(hdf5(tmp_path / "x.hdf5", arrays), "d4rl")
    said = dataset.recipe.metadata
    assert said is not None
    assert said["unread_arrays"] == "costs, infos/action_log_probs"
    assert "infos/action_log_probs" in dataset.card


# ------------------------------------------------------------------ what is published


@pytest.mark.parametrize("kind", WRITERS)
def test_what_is_published_verifies_and_its_ends_and_spaces_pass_the_audit(
    tmp_path: Path, kind: str
) -> None:
    dataset = convert(WRITERS[kind](tmp_path / "x", team(60)), kind, time_limit=5)
    assert not find_damage(dataset.path)
    assert not damage_of(dataset.path), "the card is there"
    report = audit(dataset.path, progress=False)
    checks = ("integrity", "shapes", "finite", "padding", "bounds", "ends", "leaving", "card")
    assert not [each for each in report.problems if each.check in checks]
    assert {END_REASONS[code] for code in dataset.episodes.end_reason} == {"horizon"}


def test_an_import_that_was_killed_before_the_card_gets_it_later(tmp_path: Path) -> None:
    source = hdf5(tmp_path / "x.hdf5", team(60))
    dataset = convert(source, "d4rl")
    (dataset.path / "card.md").unlink()  # as older versions left it
    assert convert(source, "d4rl").digest == dataset.digest
    assert not damage_of(dataset.path)


# ------------------------------------------------------------------ files that are not theirs


def external(file: Any, name: str, secret: Path) -> None:
    file.create_dataset(name, (60, 2), "u1", external=[(str(secret), 0, 120)])


def virtual(file: Any, name: str, secret: Path) -> None:
    with h5py.File(secret.with_suffix(".hdf5"), "w") as other:
        other["x"] = np.zeros((60, 2), np.float32)
    layout = h5py.VirtualLayout((60, 2), "f4")
    layout[:] = h5py.VirtualSource(secret.with_suffix(".hdf5"), "x", (60, 2))
    file.create_virtual_dataset(name, layout)


def external_link(file: Any, name: str, secret: Path) -> None:
    file[name] = h5py.ExternalLink(str(secret), "x")


def soft_link(file: Any, name: str, secret: Path) -> None:
    file[name] = h5py.SoftLink("/next_observations")


def texts(file: Any, name: str, secret: Path) -> None:
    file[name] = ["text"] * 60


def references(file: Any, name: str, secret: Path) -> None:
    file.create_dataset(name, data=[file["rewards"].ref] * 60, dtype=h5py.ref_dtype)


def never_stored(file: Any, name: str, secret: Path) -> None:
    file.create_dataset(name, (20_000_000, 200), "f4", chunks=(1000, 200))


@pytest.mark.parametrize(
    ("plant", "words", "exported"),
    [
        (external, "has its content in other files", True),
        (virtual, "has its content in other files", False),
        (external_link, "is a ExternalLink", True),
        (soft_link, "is a SoftLink", False),
        (texts, "of type object", True),
        (references, "of type object", False),
        (never_stored, "declares 16,000 MB, but stores 0.000 MB", False),
    ],
)
def test_hdf5_gives_nothing_but_its_own_numbers(
    tmp_path: Path, ours: Dataset, plant: Callable[..., None], words: str, exported: bool
) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(120))
    source = tmp_path / "in" / "x.hdf5"
    source.parent.mkdir()
    name = "observations"
    if exported:
        export_dataset(ours, source, format="d4rl")
        name = "infos/states"
    else:
        hdf5(source, team(60))
    with h5py.File(source, "r+") as file:
        del file[name]
        plant(file, name, secret)
    refused(source, "d4rl", words)


def test_a_chunk_that_fills_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is unpacked as a whole, so that blocks of rows bound nothing."""
    monkeypatch.setattr("swarmdata.interop.conversion.hdf5_reader.MOST_CHUNK_BYTES", 1_000_000)
    source = hdf5(tmp_path / "x.hdf5", team(60))
    with h5py.File(source, "r+") as file:
        zeros = np.zeros((500_000, 1), np.float32)
        file.create_dataset("costs", data=zeros, chunks=zeros.shape, compression="gzip")
    refused(source, "d4rl", "costs has chunks of 2 MB, expected at most 1 MB")


def test_links_out_of_a_folder_and_pipes_are_refused(tmp_path: Path) -> None:
    folder = numpy_folder(tmp_path / "x", team(60))
    (folder / "obs_0.npy").rename(tmp_path / "secret.npy")
    (folder / "obs_0.npy").symlink_to(tmp_path / "secret.npy")
    refused(folder, "numpy", "obs_0.npy is a symbolic link that leads out of", time_limit=5)
    os.mkfifo(tmp_path / "pipe")
    refused(tmp_path / "pipe", "d4rl", "neither a file nor a folder")


def test_a_parquet_file_that_fills_the_memory_is_refused(tmp_path: Path) -> None:
    n = 30_000
    wide = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(np.zeros(n * 400, "f4")), 400)
    flags = pyarrow.array(np.arange(n) % 5 == 4)
    zeros = pyarrow.array(np.zeros(n, "f4"))
    table = pyarrow.table({
        "observations": wide, "next_observations": wide, "actions": zeros, "rewards": zeros,
        "terminations": flags, "truncations": flags,
    })  # fmt: skip
    path = tmp_path / "x.parquet"
    pq.write_table(table, path, compression="zstd")
    refused(path, "parquet", "declares 96 MB, but stores 0.0")


# ------------------------------------------------------------------ Minari


def minari_folder(folder: Path) -> Path:
    rows = np.arange(6.0)
    episodes = (
        {"observations": np.stack([rows, np.full(6, k)], 1), "actions": np.arange(5) % 4,
         "rewards": rows[:5], "terminations": np.arange(5) == 4, "truncations": np.zeros(5, bool)}
        for k in range(20)
    )  # fmt: skip
    box = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    return write_minari(folder, episodes, box, spaces.Discrete(4))


def test_minari_is_looked_at_before_minari_opens_it(tmp_path: Path) -> None:
    source = minari_folder(tmp_path / "x")
    file = source / "main_data.hdf5"
    original, secret = file.read_bytes(), tmp_path / "secret"
    secret.write_bytes(bytes(120))

    def changed(words: str, change: Callable[[Any], Any], *lost: str) -> None:
        file.write_bytes(original)
        with h5py.File(file, "r+") as opened:
            for name in lost:
                del opened[name]
            change(opened.get("episode_3"))
        refused(source, "minari", words)

    rewards = "episode_3/rewards"
    changed("has its content in other", lambda group: external(group, "rewards", secret), rewards)
    changed("is a ExternalLink", lambda group: external_link(group, "rewards", secret), rewards)
    for value, words in ((1j, "has values of type complex"), (1e39, r"reward.* is not finite")):
        values = [value] * 5
        changed(words, partial(h5py.Group.create_dataset, name="rewards", data=values), rewards)
    changed("episode 3 cannot be read", bool, rewards)
    changed("cannot be read", bool, "episode_3")
    changed("bounds: action 7 of agent 0", lambda group: setitem(group["actions"], 2, 7))
    changed("above 16777216", lambda group: setitem(group["observations"], 2, 1.7e9 + 0.25))


def test_infos_of_minari_that_nothing_takes_are_named(tmp_path: Path) -> None:
    source = minari_folder(tmp_path / "x")
    with h5py.File(source / "main_data.hdf5", "r+") as file:
        file["episode_0/infos/costs"] = np.zeros(5)
    said = convert(source, "minari").recipe.metadata
    assert said == {"unread_arrays": "infos/costs"}


def test_minari_makes_no_environment(tmp_path: Path) -> None:
    """Without spaces, it would call whatever the metadata name."""
    source = minari_folder(tmp_path / "x")
    text = (source / "metadata.json").read_text()
    (source / "metadata.json").write_text(text.replace('"action_space"', '"other"'))
    refused(source, "minari", "lacks action_space in its metadata.json")
