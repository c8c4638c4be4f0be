"""Training on a stored dataset gives what training on the same episodes in memory gives."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the trainer needs torch")

from swarmdata.datasets.dataset import Dataset  # noqa: E402
from swarmdata.learn.networks.dataset_statistics import Statistics  # noqa: E402
from swarmdata.learn.training.run_folder import load_run, read_run  # noqa: E402
from swarmdata.learn.training.trainer import Schedule, train_seeds  # noqa: E402
from swarmdata.offline_algos.filtered_bc import FilteredBCConfig  # noqa: E402
from swarmdata.offline_algos.maddpg_bc import MADDPGBCConfig  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from swarmdata.testing.synthetic import make_dataset  # noqa: E402

CONFIG = MADDPGBCConfig(
    n_updates=20, batch_size=8, actor_hidden=(8,), critic_hidden=(8,), bc_warmup_updates=4
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("stored") / "ds"
    make_dataset(folder, [[3, 1, 7, 4, 2, 9, 1, 6, 1, 1, 12]])
    return Dataset.open(folder).split("train")


def test_a_run_on_a_split_is_recorded_resumed_and_loaded(dataset: Dataset, tmp_path: Path) -> None:
    schedule = Schedule(log_every=5, checkpoint_every=5)
    train_seeds("maddpg_bc", dataset, tmp_path, config=CONFIG, schedule=schedule, progress=False)
    run = read_run(tmp_path)
    assert (run.dataset, run.digest, run.n_episodes) == (dataset.id, dataset.digest, len(dataset))
    again = train_seeds(
        "maddpg_bc", dataset, tmp_path, config=CONFIG, schedule=schedule, progress=False
    )
    assert len(again) == len(load_run(tmp_path)) == 3


def test_statistics_are_those_of_the_same_episodes_in_memory(dataset: Dataset) -> None:
    stored = Statistics.measure(dataset, 0.9)
    memory = Statistics.measure(MemoryDataset(list(dataset)), 0.9)
    np.testing.assert_allclose(stored.state_mean, memory.state_mean)
    np.testing.assert_allclose(stored.state_std, memory.state_std)
    np.testing.assert_allclose(stored.observation_std, memory.observation_std, rtol=1e-5)
    assert stored.max_return == memory.max_return


def test_an_algorithm_that_chooses_episodes_learns_from_a_view(
    dataset: Dataset, tmp_path: Path
) -> None:
    config = FilteredBCConfig(n_updates=5, batch_size=8, hidden=(8,), fraction=0.3)
    ours = train_seeds(
        "filtered_bc", dataset, tmp_path / "a", seeds=[0], config=config, progress=False
    )
    run = read_run(tmp_path / "a")
    assert run.min_return is not None
    view = dataset.filter(min_return=run.min_return)
    assert 0 < len(view) == run.n_episodes < len(dataset)
    same = train_seeds("filtered_bc", view, tmp_path / "b", seeds=[0],
                 config=replace(config, fraction=1.0), progress=False)  # fmt: skip
    seen = dataset[0].observations
    assert np.array_equal(ours[0].actions(seen), same[0].actions(seen))  # type: ignore[attr-defined]
