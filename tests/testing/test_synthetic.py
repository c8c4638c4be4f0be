"""The large synthetic dataset of the benchmarks has the shapes of a real one."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks.large_dataset import make_large_dataset


@pytest.mark.slow  # of benchmarks only
def test_a_large_dataset_has_the_shapes_of_a_real_one(tmp_path: Path) -> None:
    manifest = make_large_dataset(tmp_path / "ds", 9_000)
    env, episode = make_env(TaskSpec()), Dataset.open(tmp_path / "ds")[0]
    assert 9_000 <= manifest.n_steps < 9_125
    assert episode.observations.shape[1:] == (4, env.observation_size)
    assert episode.states.shape[1:] == (env.state_size,)
    assert episode.sent.size == episode.ages.size == 0
    assert [path.name for path in tmp_path.iterdir()] == ["ds"]
