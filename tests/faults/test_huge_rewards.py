"""Rewards at the end of float32: sums and statistics hold them, training says that it cannot."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmdata.cards.card import card_of
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import DivergedError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.types import Episode, Float
from tests.interop.conftest import recorded_episodes, write_recording

HUGE = np.float32(3e38)
Rewards = Callable[[Episode], Episode]


def same(episode: Episode) -> Episode:
    return paid(episode, np.full_like(episode.rewards, HUGE))


def alternating(episode: Episode) -> Episode:
    signs = np.where(np.arange(len(episode)) % 2, -1, 1).astype(np.float32)[:, None]
    return paid(episode, np.full_like(episode.rewards, HUGE) * signs)


def paid(episode: Episode, rewards: Float) -> Episode:
    """With these rewards, of which agents that have left get none."""
    alive = True if episode.alive is None else episode.alive[:-1]
    return dataclasses.replace(episode, rewards=np.where(alive, rewards, np.float32(0)))


def recorded(folder: Path, rewards: Rewards) -> Dataset:
    written = write_recording(folder, [*map(rewards, recorded_episodes(range(20, 29)))])
    return Dataset.open(written.path, "full")


@pytest.mark.parametrize("rewards", [same, alternating])
def test_sums_and_statistics_hold_them(tmp_path: Path, rewards: Rewards) -> None:
    """Row 68: of a team, an episode, a dataset; on the card, and there and back in a format."""
    dataset = recorded(tmp_path, rewards)
    for index, episode in enumerate(dataset):
        expected = episode.rewards.astype(np.float64).mean(axis=1).sum()
        assert episode.team_return == pytest.approx(expected)
        assert dataset.episodes.team_return[index] == pytest.approx(expected)
    assert math.isfinite(dataset.stored.manifest.statistics.reward_std)
    assert "nan" not in card_of(dataset.path)
    assert "inf " not in card_of(dataset.path)
    export_dataset(dataset, tmp_path / "x.hdf5", format="d4rl")
    again = import_dataset(tmp_path / "x.hdf5", tmp_path / "again", format="d4rl", id=dataset.id)
    np.testing.assert_array_equal(again[3].rewards, dataset[3].rewards)


def test_training_says_that_it_cannot(tmp_path: Path) -> None:
    """Row 68: their squares overflow in a critic; one error, and no checkpoint."""
    pytest.importorskip("torch", reason="training needs torch")
    from swarmdata.learn.training.trainer import train_seeds
    from swarmdata.offline_algos.vdn import VDNConfig
    from tests.learn.training.test_trainer import dataset
    from tests.support.memory_dataset import MemoryDataset

    huge = MemoryDataset([same(episode) for episode in dataset()])
    with pytest.raises(DivergedError, match=r"losses of seed 0, .* is nan|is inf.*smaller rewards"):
        train_seeds(
            "vdn",
            huge,
            tmp_path / "run",
            seeds=(0,),
            config=VDNConfig(n_updates=20),
            progress=False,
        )
    assert not (tmp_path / "run" / "checkpoint.safetensors").exists()
