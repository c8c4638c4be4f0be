"""Distances of beams are found in any observation that has some."""

import numpy as np

from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_env
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float


def scan(model: str) -> Float | None:
    env = make_env(with_models(TaskSpec(), model, "perfect"), 3)
    return scan_of(env.features, env.reset(np.arange(3, dtype=np.uint64)).observations)


def test_one_distance_of_the_newest_frame_for_each_ray() -> None:
    plain, stacked = scan("lidar-12"), scan("lidar-12+stack-3")
    assert plain is not None
    assert plain.shape == (3, 4, 12)
    assert 0 <= plain.min() < plain.max() == 1
    np.testing.assert_array_equal(plain, stacked)
    assert scan("state") is None
