"""Cost signals of safe reinforcement learning, computed from the recorded events of a step.

Safe learners keep the expected sum of a cost over an episode and all robots below a budget (Altman
1999, "Constrained Markov Decision Processes").
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.types import EVENTS, Float

COSTS = ("robot_collisions", "obstacle_collisions")
"""Columns of costs: half of the robot's contacts with other robots that began in this step, so that
a pair costs 1, and those with obstacles and walls. Their sums are the metrics of these names."""

_FIRST = EVENTS.index("robot_onsets")
_SHARES = np.array([0.5, 1.0], dtype=np.float32)


def costs_of(events: NDArray[Any]) -> Float | None:
    """Returns the costs of steps, [..., N, 2], of events [..., N, 4]; None without any."""
    if not events.shape[-1]:
        return None
    return events[..., _FIRST:] * _SHARES
