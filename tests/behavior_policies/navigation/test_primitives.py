"""Obstacles as convex shapes: the same surfaces, and as many as the spec tells."""

import numpy as np
import pytest

from swarmdata.behavior_policies.navigation.episode_maps import n_primitives, primitives_of
from swarmdata.numerics.geometry import BOX, CIRCLE, CORNER, POCKET, nearest
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env, make_task
from swarmdata.specs.task_spec import TaskSpec


@pytest.mark.parametrize("kind", [CIRCLE, BOX, CORNER, POCKET])
def test_primitives_are_the_same_obstacle(kind: float) -> None:
    row = np.array([kind, 0.3, -0.2, 0.6, 0.8, 0.35, 0.3, 0.05], dtype=np.float32)
    parts = primitives_of(row[None])
    for x, y in np.random.default_rng(0).uniform(-1.5, 1.5, size=(300, 2)):
        distance = min(nearest(x, y, part)[0] for part in parts)
        assert distance == pytest.approx(nearest(x, y, row)[0], abs=1e-6)


def test_the_spec_tells_the_number_of_primitives() -> None:
    spec = TaskSpec()
    layout = make_env(spec, 1).reset(evaluation_seeds(1)).layouts[0]
    assert len(primitives_of(layout)) == n_primitives(make_task(spec).kinds) == 2 + 1 + 2 + 2 * 3
    empty = np.zeros((0, 8), dtype=np.float32)
    assert primitives_of(empty).shape == (0, 8)
