"""Cost signals of safe reinforcement learning, computed from the recorded events of a step.

They add no bytes to a dataset. Safe learners keep the expected sum of a cost over an episode, over
all robots, below a budget (Altman 1999, "Constrained Markov Decision Processes").
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.types import EVENTS, Column, Float

COST_COLUMNS = (
    Column(
        "robot_collisions",
        "half of the contacts of the robot with other robots that began in this step, so that a "
        "pair of robots costs 1",
        low=0,
    ),
    Column(
        "obstacle_collisions",
        "contacts of the robot with obstacles and walls that began in this step",
        low=0,
    ),
)
"""Columns of costs. Their sums over robots and steps are the metrics of these names."""

COSTS = tuple(column.name for column in COST_COLUMNS)

_FIRST = EVENTS.index("robot_onsets")
_SHARES = np.array([0.5, 1.0], dtype=np.float32)


def costs_of(events: NDArray[Any]) -> Float | None:
    """Returns the costs of steps, [..., N, 2], or None where no events were recorded.

    Args:
        events: columns `types.EVENTS`, uint8 [..., N, 4]; [..., N, 0] without events.
    """
    if not events.shape[-1]:
        return None
    return events[..., _FIRST:] * _SHARES
