"""Folders of OMAR's and CFCQL's NumPy files."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.types import END_REASONS, Episode
from tests.interop.foreign import TakeIn

LENGTH = 5
WIDTHS = (3, 4)  # of two agents' observations


def write_run(folder: Path, n_episodes: int, run: int = 0, states: bool = False) -> Path:
    """Observation: run and episode, time, agent; action and reward: the time."""
    folder.mkdir(parents=True)
    episode = np.repeat(np.arange(n_episodes), LENGTH) + 1000.0 * run
    time = np.tile(np.arange(LENGTH), n_episodes)
    for agent, width in enumerate(WIDTHS):
        rows = np.stack([episode, time, np.full(len(time), agent), time][:width], 1)
        after = np.stack([episode, time + 1, np.full(len(time), agent), time + 1][:width], 1)
        arrays = {
            "obs": rows,
            "next_obs": after,
            "acs": np.stack([time, time], 1) / LENGTH,
            "rews": time + 10.0 * agent,
            "dones": (time == LENGTH - 1).astype(np.float64),
        }
        if states:
            arrays |= {"states": rows[:, :2], "next_states": after[:, :2]}
        for name, values in arrays.items():
            np.save(folder / f"{name}_{agent}.npy", values)
    return folder


def check(episodes: Iterable[Episode], n_episodes: int, run: int = 0) -> None:
    episodes = list(episodes)
    assert len(episodes) == n_episodes
    for number, episode in enumerate(episodes):
        t = np.arange(LENGTH)
        assert END_REASONS[episode.end_reason] == "horizon"
        assert (episode.observations[:, :, 0] == 1000 * run + number).all()
        np.testing.assert_array_equal(episode.observations[:, 0, 1], np.arange(LENGTH + 1))
        np.testing.assert_array_equal(episode.observations[:, 1, 3], np.arange(LENGTH + 1))
        assert not episode.observations[:, 0, 3].any(), "padding is zero"
        np.testing.assert_array_equal(episode.actions[:, 0, 0], (t / LENGTH).astype(np.float32))
        np.testing.assert_array_equal(episode.rewards, np.stack([t, t + 10], 1))


def test_one_folder(tmp_path: Path, take_in: TakeIn) -> None:
    source = write_run(tmp_path / "seed_0_data", 30)
    with pytest.raises(ConversionError, match="does not say which episodes a time limit truncated"):
        take_in(source, "numpy")
    dataset = take_in(source, "numpy", time_limit=LENGTH, action_low=-1.0, action_high=1.0)
    check(dataset.episodes, 30)
    spec = dataset.spec
    assert spec.kind == "recorded"
    assert [a.observation.shape for a in spec.agents] == [(3,), (4,)]
    assert spec.agents[0].action.low == -1.0
    assert spec.horizon == LENGTH
    assert dataset.episodes[0].states.shape == (LENGTH + 1, 7), "all observations without padding"
    assert dataset.metadata["time_limit"] == str(LENGTH)


def test_several_runs_are_policies(tmp_path: Path) -> None:
    for run in (0, 2, 10):
        write_run(tmp_path / f"expert/seed_{run}_data", 20, run, states=True)
    dataset = import_dataset(
        tmp_path / "expert", tmp_path / "out", format="numpy",
        id="simple_spread-omar_expert-v0", time_limit=LENGTH,
    )  # fmt: skip
    labels = [source.label for source in dataset.recipe.policies]
    assert labels == ["seed_0_data", "seed_2_data", "seed_10_data"], "in the order of the numbers"
    check(dataset.filter(policy="seed_10_data"), 20, run=10)
    assert dataset[0].states.shape == (LENGTH + 1, 2)
    np.testing.assert_array_equal(dataset[0].states[:, 1], np.arange(LENGTH + 1))


def test_what_does_not_fit_is_refused(ours: Dataset, tmp_path: Path, take_in: TakeIn) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConversionError, match=r"neither obs_0\.npy nor folders"):
        take_in(tmp_path / "empty", "numpy")
    absent, short, objects, wrong = (write_run(tmp_path / name, 3) for name in "abcd")
    (absent / "acs_1.npy").unlink()
    np.save(short / "rews_1.npy", np.zeros(4))
    np.save(objects / "dones_0.npy", np.array([object()] * 15), allow_pickle=True)
    for folder, words in (
        (absent, r"acs_1\.npy is missing"),
        (short, "arrays of different lengths"),
        (objects, "not a NumPy file of numbers"),
    ):
        with pytest.raises(ConversionError, match=words):
            take_in(folder, "numpy", time_limit=LENGTH)
    for agent in range(2):
        np.save(wrong / f"dones_{agent}.npy", np.zeros(3 * LENGTH))
    with pytest.raises(ConversionError, match="next_observations of row 4 differs"):
        take_in(wrong, "numpy", episode_length=LENGTH * 3)


def test_an_export_is_as_others_write_it(ours: Dataset, tmp_path: Path) -> None:
    """Without our note it is read as theirs is, with the time limit that ended episodes."""
    path = export_dataset(ours, tmp_path / "out", format="numpy")
    (path / "swarmdata.json").unlink()
    lengths = ours.episodes.lengths
    dones = np.load(path / "dones_1.npy")
    np.testing.assert_array_equal(np.flatnonzero(dones), np.cumsum(lengths) - 1)
    assert np.load(path / "obs_0.npy").shape == (lengths.sum(), ours[0].observations.shape[2])
    dataset = import_dataset(
        path, tmp_path / "again", format="numpy", id="coop_nav-again-v0",
        time_limit=int(lengths.max()),
    )  # fmt: skip
    for mine, theirs in zip(dataset, ours, strict=True):
        np.testing.assert_array_equal(mine.observations, theirs.observations)
        np.testing.assert_array_equal(mine.rewards, theirs.rewards)
