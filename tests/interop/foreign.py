"""Data as others write them: rows of a team in files of three formats, however odd they are."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from swarmdata.types import END_REASONS, Episode

Arrays = dict[str, Any]
NEEDS = {
    "lerobot": "pyarrow", "minari": "minari", "parquet": "pyarrow", "torchrl": "torchrl",
    "vault": "flashbax.vault",
}  # fmt: skip
TakeIn = Callable[..., Any]  # gives `Taken` of conftest.py


def team(n: int = 60, n_agents: int = 2, length: int = 5) -> Arrays:
    """Rows of a team whose observations say agent and row; episodes of `length`."""
    rows = np.arange(n)
    seen = np.stack([np.stack([rows, np.full(n, k)], 1) for k in range(n_agents)], 1)
    last = rows % length == length - 1
    return {
        "observations": seen.astype(np.float32),
        "next_observations": (seen + np.array([1, 0])).astype(np.float32),
        "actions": seen.astype(np.float32)[..., :1] / max(1, n),
        "rewards": rows.astype(np.float32),
        "terminals": np.zeros((n, n_agents), bool),
        "timeouts": np.repeat(last[:, None], n_agents, 1),
    }


def timeline(lengths: list[int], cut: list[bool]) -> Arrays:
    """One agent's rows: observation (episode, time), action (time, episode), reward of both."""
    episode = np.repeat(np.arange(len(lengths)), lengths)
    time = np.concatenate([np.arange(n) for n in lengths])
    last = np.concatenate([np.arange(n) == n - 1 for n in lengths])
    is_cut = np.repeat(cut, lengths)
    return {
        "observations": np.stack([episode, time], 1).astype(np.float32),
        "next_observations": np.stack([episode, time + 1], 1).astype(np.float32),
        "actions": np.stack([time, episode], 1).astype(np.float32),
        "rewards": (100 * episode + time).astype(np.float32),
        "terminals": last & ~is_cut,
        "timeouts": last & is_cut,
    }


def check_timeline(
    episodes: Iterable[Episode], lengths: list[int], cut: list[bool], *, has_next: bool = True
) -> None:
    """Every agent has the rows of a `timeline`; without `has_next`, the last state is made up."""
    found = list(episodes)
    assert [len(episode) for episode in found] == lengths
    ends = [END_REASONS[episode.end_reason] for episode in found]
    assert ends == ["horizon" if each else "ended" for each in cut]
    for number, episode in enumerate(found):
        t, n = np.arange(len(episode))[:, None], len(episode) + has_next
        assert (episode.observations[..., 0] == number).all(), "another episode's rows"
        times = episode.observations[:n, :, 1]
        np.testing.assert_array_equal(times, np.broadcast_to(np.arange(n)[:, None], times.shape))
        np.testing.assert_array_equal(episode.actions[..., 0], t + 0 * episode.actions[..., 0])
        np.testing.assert_array_equal(episode.rewards, 100 * number + t + 0 * episode.rewards)


def write_minari(
    folder: Path, episodes: Iterable[Arrays], observation: Any, action: Any, **options: Any
) -> Path:
    """What Minari itself writes for one agent; `episodes` are fields of its `EpisodeBuffer`."""
    minari = pytest.importorskip("minari", reason="the extra 'minari'")
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    storage = MinariStorage.new(
        folder, observation_space=observation, action_space=action, **options
    )
    storage.update_episodes(EpisodeBuffer(**each) for each in episodes)
    storage.update_metadata({"dataset_id": "maze/x-v0", "minari_version": minari.__version__})
    return folder


def hdf5(path: Path, arrays: Arrays) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return path


def parquet(path: Path, arrays: Arrays) -> Path:
    """A column that is shorter than the others has nulls at its end."""
    pyarrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    pq = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")
    names = {"terminals": "terminations", "timeouts": "truncations"}
    most = max((len(values) for values in arrays.values()), default=0)
    columns = {}
    for name, values in arrays.items():
        given = np.abs(values) if values.dtype.kind == "c" else values
        columns[names.get(name, name)] = given.tolist() + [None] * (most - len(given))
    table = pyarrow.table({name: pyarrow.array(column) for name, column in columns.items()})
    pq.write_table(table, path)
    return path


def numpy_folder(path: Path, arrays: Arrays) -> Path:
    """Files of each agent; its `dones` are all ends."""
    path.mkdir()
    names = {
        "observations": "obs", "next_observations": "next_obs", "actions": "acs",
        "rewards": "rews", "terminals": "dones",
    }  # fmt: skip
    terminals, timeouts = (arrays.get(name, np.zeros(())) for name in ("terminals", "timeouts"))
    if terminals.dtype == np.bool_ and terminals.shape == timeouts.shape:
        arrays = {**arrays, "terminals": terminals | timeouts.astype(bool)}
    n_agents = max((each.shape[1] for each in arrays.values() if each.ndim > 1), default=1)
    for ours in names.keys() & arrays.keys():
        values = arrays[ours]
        for k in range(n_agents):
            is_team = values.ndim > 1 and values.shape[1]
            own = values[:, min(k, values.shape[1] - 1)] if is_team else values
            np.save(path / f"{names[ours]}_{k}.npy", own)
    return path


WRITERS: dict[str, Callable[[Path, Arrays], Path]] = {
    "d4rl": hdf5,
    "parquet": parquet,
    "numpy": numpy_folder,
}
