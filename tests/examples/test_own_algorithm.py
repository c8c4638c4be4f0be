"""The example trains, and its results are reported beside others."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import swarmdata
from tests.examples import own_algorithm as example
from tests.support.tiny import TINY, make_tiny


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> swarmdata.Dataset:
    path = make_tiny(tmp_path_factory.mktemp("own") / TINY.id, n_steps=160)
    return swarmdata.load(path, progress=False)


def test_a_short_run_is_reported_beside_others(dataset: swarmdata.Dataset, tmp_path: Path) -> None:
    files = example.main(str(dataset.path), tmp_path, n_seeds=2, n_updates=3, n_episodes=2)
    idle = swarmdata.make_policy("idle", dataset.task)
    other = swarmdata.evaluate(idle, dataset.task, name="idle", n_episodes=2, progress=False)
    provenance = swarmdata.Provenance(
        label="idle", dataset=dataset.id, digest=dataset.digest, algorithm="idle"
    )
    swarmdata.save_result(swarmdata.Result(other, provenance, dataset.task), tmp_path)
    (case,) = swarmdata.read_results([tmp_path], data=[dataset.path]).cases
    assert set(case.runs) == {"mine", "idle"}
    assert [result.path for result in case.runs["mine"]] == files
    assert case.metric("mine", "return").shape == (2, 2)
    assert [result.provenance.seed for result in case.runs["mine"]] == [0, 1]


def test_the_seed_determines_the_policy(dataset: swarmdata.Dataset) -> None:
    step = dataset.make_env(2).reset(np.arange(2, dtype=np.uint64))
    actions = [example.train(dataset, seed, 3).act(step) for seed in (0, 0, 1)]
    assert np.array_equal(actions[0], actions[1])
    assert not np.array_equal(actions[0], actions[2])
