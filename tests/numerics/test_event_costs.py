"""Costs come from events, wherever they are read."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from swarmdata import make_env
from swarmdata.datasets.dataset import Dataset
from swarmdata.interop.export import export_dataset
from swarmdata.numerics.event_costs import COSTS, costs_of
from swarmdata.registry.components import make_policy, make_task
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec


@pytest.fixture
def collisions(record: Callable[..., Path], tmp_path: Path) -> Dataset:
    """Episodes of robots that drive straight into whatever there is."""
    return Dataset.open(record(tmp_path / "data", TaskSpec(horizon=60), ("straight",)))


def test_sums_of_costs_are_the_metrics() -> None:
    spec = TaskSpec(horizon=60)
    env, seeds = make_env(spec, 4), np.arange(8, dtype=np.uint64)
    total = np.zeros(len(COSTS))
    for episode in rollout(env, make_policy("straight", spec), seeds):
        costs = costs_of(episode.events)
        assert costs is not None
        assert costs.shape == (len(episode), spec.n_agents, len(COSTS))
        metrics = episode_metrics(episode, make_task(spec))
        assert costs.sum(axis=(0, 1)).tolist() == [metrics[name] for name in COSTS]
        total += costs.sum(axis=(0, 1))
    assert (total > 0).all()


def test_batches_and_transitions_have_them(collisions: Dataset) -> None:
    every = collisions.transitions()
    assert every["costs"].sum() > 0
    sampler = collisions.sampler(batch_size=64, seed=1)
    index = sampler.draw()
    batch = sampler.gather(index)
    expected = costs_of(collisions.stored.arrays["events"][index])
    assert expected is not None
    assert np.array_equal(batch.costs, expected)
    windows = collisions.sampler(batch_size=16, horizon=50, seed=1)
    found = next(windows)
    assert found.costs.shape == (16, 50, collisions.spec.n_agents, len(COSTS))
    assert not found.costs[~found.mask].any()


def test_a_d4rl_file_has_the_cost_of_the_team(collisions: Dataset, tmp_path: Path) -> None:
    path = export_dataset(collisions, tmp_path / "data.hdf5", format="d4rl")
    with h5py.File(path) as file:
        costs = file["costs"][:]
    assert np.array_equal(costs, collisions.transitions()["costs"].sum(axis=(1, 2)))


def test_without_events_there_are_none() -> None:
    assert costs_of(np.zeros((5, 3, 0), np.uint8)) is None
