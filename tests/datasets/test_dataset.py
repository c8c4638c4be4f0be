import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.normalization import Moments, Statistics
from swarmdata.errors import MissingExtraError, MissingFileError, SchemaError, UnknownNameError
from swarmdata.registry.published import Reference
from swarmdata.store import SPLITS
from swarmdata.testing import dataset_contract as contract
from swarmdata.testing.synthetic import N_AGENTS, N_FEATURES, make_dataset
from swarmdata.types import Episode

LENGTHS = [[3, 1, 7, 4, 2, 9, 1, 6, 1, 1, 12], [5, 5, 1, 8, 1, 1, 3, 2, 9, 9, 9]]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Episode]]:
    path = tmp_path_factory.mktemp("dataset") / "ds"
    return path, make_dataset(path, LENGTHS, n_steps=60)[1]


@pytest.fixture
def dataset(stored: tuple[Path, list[Episode]]) -> Dataset:
    return Dataset.open(stored[0], references=Reference(no_skill=-2.0, expert=8.0))


@pytest.fixture
def episodes(stored: tuple[Path, list[Episode]]) -> list[Episode]:
    return stored[1]


def assert_equal_episodes(first: Episode, second: Episode) -> None:
    for name in Episode.__dataclass_fields__:
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


def test_a_spec_knows_its_widths(dataset: Dataset) -> None:
    env = dataset.make_env()
    assert dataset.spec.observation_size == env.observation_size
    assert dataset.spec.state_size == env.state_size


def test_episodes_come_back_in_order(dataset: Dataset, episodes: list[Episode]) -> None:
    assert len(dataset) == dataset.n_episodes == len(episodes)
    assert dataset.n_steps == sum(map(len, episodes))
    for got, expected in zip(dataset, episodes, strict=True):
        assert_equal_episodes(got, expected)
    assert_equal_episodes(dataset[-1], episodes[-1])
    with pytest.raises(IndexError, match=f"episode {len(episodes)} of {len(episodes)}"):
        dataset[len(episodes)]


def test_nothing_is_copied_and_nothing_can_be_written(dataset: Dataset) -> None:
    episode = dataset.split("train")[0]
    assert np.shares_memory(episode.observations, dataset.stored.arrays["observations"])
    for name in ("observations", "actions", "layout"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(episode, name)[...] = 0


def test_identity(dataset: Dataset) -> None:
    assert dataset.id == "coop_nav-synthetic-v0"
    assert dataset.spec.n_agents == N_AGENTS
    assert len(dataset.digest) == 64
    assert dataset.source == "folder"
    text = repr(dataset.filter(policy="tag-1"))
    assert dataset.id in text
    assert f"of {len(dataset)} episodes" in text


def test_splits_partition(dataset: Dataset) -> None:
    views = [dataset.split("train"), dataset.split("validation"), dataset.split("test")]
    together = np.concatenate([view.selection for view in views])
    assert sorted(together) == list(range(len(dataset)))
    assert all(len(view) for view in views)
    for code, view in enumerate(views):
        assert (view.episodes.split == code).all()
        assert SPLITS[code] in ("train", "validation", "test")
        assert [e.seed for e in view] == view.episodes.seeds.tolist()


@settings(deadline=None)
@given(
    success=st.none() | st.booleans(),
    low=st.none() | st.floats(-5, 5),
    high=st.none() | st.floats(-5, 5),
    policy=st.sampled_from([None, "tag-0", "tag-1"]),
    split=st.sampled_from([None, *SPLITS]),
)
def test_filters_keep_exactly_what_they_say(
    stored: tuple[Path, list[Episode]],
    success: bool | None,
    low: float | None,
    high: float | None,
    policy: str | None,
    split: str | None,
) -> None:
    dataset = Dataset.open(stored[0], verify="none")
    view = dataset.filter(
        success=success, min_return=low, max_return=high, policy=policy, split=split
    )
    codes = dataset.episodes.split
    expected = [
        index
        for index, episode in enumerate(stored[1])
        if success in (None, episode.success)
        and (low is None or episode.team_return >= low)
        and (high is None or episode.team_return <= high)
        and policy in (None, f"tag-{episode.policy}")
        and split in (None, SPLITS[codes[index]])
    ]
    assert view.selection.tolist() == expected
    again = view.filter(success=success).filter(policy=policy)
    assert again.selection.tolist() == expected


def test_unknown_names_are_explained(dataset: Dataset) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'train'"):
        dataset.filter(split="trian")
    with pytest.raises(UnknownNameError, match="Known: tag-0, tag-1"):
        dataset.filter(policy="expert")
    with pytest.raises(UnknownNameError, match="pettingzoo"):
        dataset.make_env(api="gym")  # type: ignore[call-overload]
    with pytest.raises(SchemaError, match="n_copies=2"):
        dataset.make_env(2, api="pettingzoo")
    with pytest.raises(UnknownNameError, match="Did you mean 'mujoco'"):
        dataset.make_env(backend="mujuco")
    with pytest.raises(UnknownNameError, match="Did you mean 'rewards'"):
        next(dataset.read("reward"))
    with pytest.raises(UnknownNameError, match="'episodes/layouts'"):  # no rows over time
        next(dataset.read("episodes/layouts"))


def test_the_recorded_world_in_another_simulator(dataset: Dataset) -> None:
    env = dataset.make_env(2, backend="kinematic")
    assert env.spec == dataset.task.with_updates(backend="kinematic")
    assert dataset.make_env().spec == dataset.task


def test_transitions_are_aligned_and_complete(dataset: Dataset) -> None:
    view = dataset.split("train")
    transitions = view.transitions()
    lengths = view.episodes.lengths
    assert {len(values) for values in transitions.values()} == {view.n_steps}
    seeds = np.repeat(view.episodes.seeds, lengths)
    times = np.concatenate([np.arange(n) for n in lengths])
    assert np.array_equal(transitions["episodes"], np.repeat(np.arange(len(view)), lengths))
    for name, step in (("observations", 0), ("next_observations", 1)):
        assert np.array_equal(transitions[name][:, 0, 0], seeds)
        assert np.array_equal(transitions[name][:, 0, 1], times + step)
        assert np.array_equal(transitions[name][:, 1, 2], np.ones(view.n_steps))
    assert np.array_equal(transitions["next_states"][:, 1], times + 1)
    assert np.array_equal(transitions["actions"], np.concatenate([e.actions for e in view]))
    assert np.array_equal(transitions["log_probs"], np.concatenate([e.log_probs for e in view]))
    ends = transitions["terminations"] | transitions["truncations"]
    assert np.array_equal(np.flatnonzero(ends), np.cumsum(lengths) - 1)


def test_normalized_score(dataset: Dataset, stored: tuple[Path, list[Episode]]) -> None:
    assert dataset.normalized_score([-2.0, 8.0, 3.0]).tolist() == [0.0, 100.0, 50.0]
    assert float(dataset.split("test").normalized_score(3.0)) == 50.0
    with pytest.raises(SchemaError, match="references"):
        Dataset.open(stored[0]).normalized_score([1.0])


@pytest.mark.parametrize("anchors", [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_useless_references_are_refused(
    anchors: tuple[float, float], stored: tuple[Path, list[Episode]]
) -> None:
    opened = Dataset.open(stored[0], references=Reference(*anchors))
    with pytest.raises(SchemaError, match="the expert's must be the larger"):
        opened.normalized_score([1.0])


def test_statistics_use_train_only(dataset: Dataset) -> None:
    train = np.concatenate([e.observations.reshape(-1, N_FEATURES) for e in dataset.split("train")])
    every = np.concatenate([e.observations.reshape(-1, N_FEATURES) for e in dataset])
    found = dataset.split("test").moments
    np.testing.assert_allclose(found.observation_mean, train.mean(0, dtype=np.float64), rtol=1e-12)
    np.testing.assert_allclose(found.observation_std, train.std(0, dtype=np.float64), rtol=1e-9)
    assert not np.allclose(found.observation_mean, every.mean(0))


def test_statistics_are_ready_to_divide_by() -> None:
    deviations = np.array([0.5, 0.0, 1e-9, 2.0])
    moments = Moments(np.array([0.1, 3.0, 7.0, -1.0]), deviations, reward_mean=2.0, reward_std=0.0)
    found = Statistics.of(moments)
    assert found.observation_mean.dtype == found.observation_std.dtype == np.float32
    np.testing.assert_array_equal(found.observation_std, np.array([0.5, 1.0, 1.0, 2.0], np.float32))
    assert found.is_constant.tolist() == [False, True, True, False]
    seen = np.array([0.1, 3.0, 7.5, -1.0], np.float32)
    normalized = (seen - found.observation_mean) / found.observation_std
    np.testing.assert_array_equal(normalized, np.array([0.0, 0.0, 0.5, 0.0], np.float32))
    assert found.reward_std == 1.0
    assert repr(found).startswith("Statistics(4 features, 2 of them constant; rewards 2 ± 1;")
    assert "\n" not in repr(found)


def test_episodes_are_rows(dataset: Dataset) -> None:
    table = dataset.episodes
    rows = list(table)
    assert [row.index for row in rows] == list(range(len(dataset)))
    for row, episode in zip(rows, dataset, strict=True):
        assert (row.length, row.seed, row.success) == (len(episode), episode.seed, episode.success)
        assert row.team_return == pytest.approx(episode.team_return)
    assert table[-1] == rows[-1]
    assert table[1:3][0].seed == rows[1].seed
    long = table[table.lengths > np.median(table.lengths)]
    assert 0 < len(long) < len(table)
    assert {row.split for row in rows} <= {"train", "validation", "test"}
    assert [rows[k].seed for k in (2, 0)] == [row.seed for row in table[[2, 0]]]
    with pytest.raises(IndexError, match=f"episode {len(table)} of a table of {len(table)}"):
        table[len(table)]


def test_episodes_as_a_data_frame(dataset: Dataset) -> None:
    pandas = pytest.importorskip("pandas", reason="data frames need pandas")
    frame = dataset.episodes.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame) == len(dataset)
    for row in dataset.episodes:
        assert frame.loc[row.index, "seed"] == row.seed
        assert frame.loc[row.index, "split"] == row.split
        assert frame.loc[row.index, "team_return"] == row.team_return


def test_without_pandas_one_sentence_says_so(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="to_pandas needs 'pandas', which is not installed"):
        dataset.episodes.to_pandas()


def test_card(tmp_path: Path) -> None:
    make_dataset(tmp_path / "ds", LENGTHS, n_steps=60)
    dataset = Dataset.open(str(tmp_path / "ds"))
    with pytest.raises(MissingFileError, match="no card"):
        _ = dataset.card
    (tmp_path / "ds" / "card.md").write_text("# ä card", encoding="utf-8")
    assert dataset.card == "# ä card"


class TestContract:
    """check_dataset must fail on each promise that is broken."""

    def test_wrong_flags(self, episodes: list[Episode], dataset: Dataset) -> None:
        table = dataset.episodes
        contract.check_episode(episodes[0], table, 0)
        flags = episodes[0].truncations.copy()
        episodes[0].truncations[:] = ~flags
        with pytest.raises(SchemaError, match="episode 0"):
            contract.check_episode(episodes[0], table, 0)
        episodes[0].truncations[:] = flags

    def test_row_of_another_episode(self, episodes: list[Episode], dataset: Dataset) -> None:
        with pytest.raises(SchemaError, match="table says"):
            contract.check_episode(episodes[0], dataset.episodes, 1)

    def test_whole_suite(self, stored: tuple[Path, list[Episode]]) -> None:
        contract.check_dataset(stored[0])
        assert json.loads((stored[0] / "manifest.json").read_bytes())["n_episodes"] > 10


@pytest.mark.parametrize(
    "part", [slice(3), slice(1, None, 2), slice(-2, None), slice(None, None, -1)]
)
def test_a_slice_is_a_view(dataset: Dataset, part: slice) -> None:
    view = dataset[part]
    assert isinstance(view, Dataset)
    assert view.selection.tolist() == list(range(len(dataset)))[part]
    assert view.digest == dataset.digest
    assert_equal_episodes(view[0], dataset[int(view.selection[0])])


def test_other_indices_are_refused(dataset: Dataset) -> None:
    assert_equal_episodes(dataset[np.int64(1)], dataset[1])
    for index in ("a", 1.0, None, [0, 1]):
        with pytest.raises(SchemaError, match="expected the number of an episode or a slice"):
            dataset[index]  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"min_return": "3"}, "min_return is '3', expected a number"),
        ({"max_return": [1.0]}, "max_return is .1.0., expected a number"),
        ({"max_return": float("nan")}, "max_return is nan, expected a number"),
        ({"success": "yes"}, "success is 'yes', expected True"),
    ],
)
def test_conditions_of_another_type_are_refused(
    dataset: Dataset, conditions: dict[str, Any], message: str
) -> None:
    with pytest.raises(SchemaError, match=message):
        dataset.filter(**conditions)


def test_numbers_of_numpy_are_conditions(dataset: Dataset) -> None:
    bound = np.float32(np.median(dataset.episodes.team_return))
    found = dataset.filter(min_return=bound, success=np.True_)  # type: ignore[arg-type]
    assert len(found) == len(dataset.filter(min_return=float(bound), success=True))


def test_columns_have_names(dataset: Dataset) -> None:
    for name, array in (
        ("states", "states"), ("observations", "observations"), ("actions", "actions"),
        ("events", "events"), ("layout", "episodes/layouts"),
    ):  # fmt: skip
        columns = dataset.columns(name)
        assert len(columns) == dataset.stored.arrays[array].shape[-1], name
        assert all(column.name and column.meaning for column in columns)
    assert dataset.columns("states")[0].unit == "m"
    with pytest.raises(UnknownNameError, match="array with columns 'rewards'"):
        dataset.columns("rewards")
    with pytest.raises(SchemaError, match=f"agent {N_AGENTS} of {N_AGENTS}"):
        dataset.columns("actions", N_AGENTS)
