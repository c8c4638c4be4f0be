"""Maps of layouts in the default arena."""

import numpy as np

from swarmdata.numerics.distance_field import Ground, fill_clearances, grid_shape
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float

SPEC = TaskSpec()
HALF = np.array([2.0, 2.0])
SPACING = 0.05


def ground_of(layout: Float, cap: float = 0.27) -> Ground:
    grid = np.zeros(grid_shape(SPEC.arena, SPACING), dtype=np.float32)
    ground = Ground(grid, HALF, SPACING)
    fill_clearances(layout, cap, ground)
    return ground


def layout_of(seed: int) -> Float:
    layout: Float = make_env(SPEC, 1).reset(evaluation_seeds(seed + 1)[-1:]).layouts[0]
    return layout
