"""Constants of pursuits in an empty arena of 8 m."""

import numpy as np

from swarmdata.behavior_policies.pursuit.beliefs import Hunt
from swarmdata.behavior_policies.pursuit.ring import N_DIRECTIONS
from swarmdata.envs.pursuit.evader import direction_table
from swarmdata.envs.pursuit.sightings import Columns
from swarmdata.types import Float

NOTHING: Float = np.zeros((0, 8), np.float32)
"""A layout without obstacles."""


def hunt(n: int, n_evaders: int = 1, captors: int = 2, *, is_limited: bool = False) -> Hunt:
    """Robots of radius 0.1 m, which see for 1 m if their sight is limited."""
    return Hunt(
        Columns.of(n, n_evaders, is_limited), np.array([4.0, 4.0]), 0.1, 0.6, 1.0, 0.1, 1.0,
        captors, direction_table(N_DIRECTIONS),
    )  # fmt: skip
