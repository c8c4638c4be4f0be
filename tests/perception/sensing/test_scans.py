"""Distances of beams are found in any observation that has some."""

import numpy as np
import pytest

from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_env
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec


@pytest.mark.parametrize(
    "model", ["lidar-12", "lidar-12+stack-3", "lidar-12+noise-0.1+dropout-0.3"]
)
def test_one_distance_for_each_ray(model: str) -> None:
    env = make_env(with_models(TaskSpec(), model, "perfect"), 3)
    step = env.reset(np.arange(3, dtype=np.uint64))
    scan = scan_of(env.features, step.observations)
    assert scan is not None
    assert scan.shape == (3, 4, 12)
    assert ((scan >= 0) & (scan <= 1)).all()
    assert (scan < 1).any()
    plain = make_env(with_models(TaskSpec(), "lidar-12"), 3)
    first = plain.reset(np.arange(3, dtype=np.uint64)).observations
    newest = scan_of(plain.features, first)
    assert newest is not None
    if "noise" not in model:
        np.testing.assert_array_equal(scan, newest)
    assert newest.shape == scan.shape


def test_no_beams_no_scan() -> None:
    env = make_env(TaskSpec(), 1)
    step = env.reset(np.zeros(1, dtype=np.uint64))
    assert scan_of(env.features, step.observations) is None
