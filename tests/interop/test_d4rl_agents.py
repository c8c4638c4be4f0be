"""One D4RL-style file per agent: aligned, without padding, and without the rows of the dead."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.d4rl import read
from swarmdata.interop.export import export_dataset


def test_agents_have_their_own_rows(recorded: Dataset, tmp_path: Path) -> None:
    path = export_dataset(recorded, tmp_path / "x", format="d4rl-agents")
    assert {file.name for file in path.iterdir()} == {"adversary_0.hdf5", "agent_0.hdf5"}
    lengths = [len(episode) for episode in recorded]
    for agent, (name, n_columns, action_size, expected) in enumerate(
        [("adversary_0", 5, 1, [n // 2 + 1 for n in lengths]), ("agent_0", 3, 2, lengths)]
    ):
        with h5py.File(path / f"{name}.hdf5") as file:
            assert file["observations"].shape == (sum(expected), n_columns)
            assert file["actions"].shape == (sum(expected), action_size)
        with read(path / f"{name}.hdf5", "task", Choices(time_limit=0)) as incoming:
            episodes = list(incoming.episodes)
        assert [len(episode) for episode in episodes] == expected
        for got, whole in zip(episodes, recorded, strict=True):
            n = len(got)
            seen = whole.observations[:n, agent, :n_columns]
            np.testing.assert_array_equal(got.observations[:-1, 0], seen)
            np.testing.assert_array_equal(got.actions[:, 0], whole.actions[:n, agent, :action_size])
            np.testing.assert_array_equal(got.rewards[:, 0], whole.rewards[:n, agent])
            assert whole.agent_terminations is not None
            assert got.terminations[-1] == whole.agent_terminations[n - 1, agent]


def test_a_team_ends_together(ours: Dataset, tmp_path: Path) -> None:
    path = export_dataset(ours, tmp_path / "x", format="d4rl-agents")
    expected = ours.transitions()
    for agent, name in enumerate(ours.spec.agent_names):
        with h5py.File(path / f"{name}.hdf5") as file:
            np.testing.assert_array_equal(file["terminals"], expected["terminations"])
            np.testing.assert_array_equal(file["actions"], expected["actions"][:, agent])
            np.testing.assert_array_equal(file["infos/states"], expected["states"])
            np.testing.assert_array_equal(
                file["next_observations"], expected["next_observations"][:, agent]
            )


def test_it_is_only_written(ours: Dataset, tmp_path: Path) -> None:
    path = export_dataset(ours, tmp_path / "x", format="d4rl-agents")
    with pytest.raises(ConversionError, match="can only be written"):
        import_dataset(path, tmp_path / "out", format="d4rl-agents", id="a-b-v0")
