"""Batches for a torch `DataLoader`: the sampler's stream, whatever the number of workers."""

import itertools
import pickle
from dataclasses import fields, replace
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import mix
from swarmdata.errors import SchemaError
from swarmdata.types import Batch
from tests.support.pairs import slow

data = pytest.importorskip("torch.utils.data", reason="a DataLoader is torch's")


@pytest.fixture
def dataset(tiny: Path) -> Dataset:
    return Dataset.open(tiny, verify="none")


@pytest.mark.parametrize(
    ("n_workers", "horizon"), [(0, 4), pytest.param(2, None, marks=pytest.mark.slow)]
)
def test_a_loader_yields_the_stream_of_the_sampler(
    dataset: Dataset, n_workers: int, horizon: int | None
) -> None:
    batches = dataset.to_torch(8, horizon=horizon, seed=3)
    loader = data.DataLoader(batches, batch_size=None, num_workers=n_workers)
    stream = dataset.sampler(8, horizon=horizon, seed=3)
    for got, expected in itertools.islice(zip(loader, stream, strict=False), 7):
        np.testing.assert_array_equal(got.observations.numpy(), expected.observations)
        np.testing.assert_array_equal(got.episodes.numpy(), expected.episodes)


def test_a_worker_sends_its_tensors_together(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = pytest.importorskip("torch")
    worker = SimpleNamespace(id=0, num_workers=1)
    monkeypatch.setattr("swarmdata.datasets.torch_batches.get_worker_info", lambda: worker)
    batch = next(iter(dataset.to_torch(8)))
    sent = bytes(ForkingPickler.dumps(batch))
    assert b"rebuild_tensor" not in sent  # torch's way, which opens a file for each tensor
    got = pickle.loads(sent)
    assert type(got) is Batch
    for field in fields(Batch):
        value, expected = getattr(got, field.name), getattr(batch, field.name)
        assert value is None if expected is None else torch.equal(value, expected)
    cast = replace(batch, rewards=batch.rewards.bfloat16(), states=batch.states.numpy())
    again = pickle.loads(bytes(ForkingPickler.dumps(cast)))
    assert again.rewards.dtype == torch.bfloat16
    assert isinstance(again.states, np.ndarray)


def test_mixtures_are_loaded_too(dataset: Dataset) -> None:
    mixture = mix([dataset.split("train"), dataset[:3]], [0.5, 0.5])
    got = next(iter(data.DataLoader(mixture.to_torch(8), batch_size=None)))
    np.testing.assert_array_equal(got.actions.numpy(), next(mixture.sampler(8)).actions)


def test_mistakes_are_refused_before_any_worker(dataset: Dataset) -> None:
    with pytest.raises(SchemaError, match="batch_size=0"):
        dataset.to_torch(0)
    assert len(repr(dataset.to_torch())) <= 300


@pytest.mark.parametrize("n_workers", [0, *slow(1)])
def test_episodes_are_not_stacked(dataset: Dataset, n_workers: int) -> None:
    with pytest.raises(SchemaError, match=r"dataset\.to_torch\(256\)"):
        next(iter(data.DataLoader(dataset, batch_size=2, num_workers=n_workers)))


@pytest.mark.slow
def test_single_episodes_and_own_collations_are_loaded(dataset: Dataset) -> None:
    single = next(iter(data.DataLoader(dataset, batch_size=None)))
    np.testing.assert_array_equal(single.actions, dataset[0].actions)
    several = next(iter(data.DataLoader(dataset, batch_size=3, collate_fn=list)))
    assert [len(each) for each in several] == [len(dataset[index]) for index in range(3)]
