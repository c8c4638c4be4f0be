"""What robots hear of each other's places and targets, in the world's frame.

That is in messages with payload `pose_and_goal`; with any other, they hear nothing.
"""

import numpy as np

from swarmdata.interfaces import Task
from swarmdata.perception.observer import features_of
from swarmdata.specs.state_layout import TX, TY, UX, UY, X, Y, robots_of
from swarmdata.types import Double, Int, Step

MASK, HEARD_X, HEARD_Y, TARGET_X, TARGET_Y = range(5)
"""Columns of what a robot has heard of another: whether it has a message, where the sender was, and
its target, m."""

_TOLD = ("mask", "position_x", "position_y", "target_x", "target_y")
"""Features of a message, in the order of these columns."""


class HeardGoals:
    """Reads the newest message of every robot from observations."""

    def __init__(self, task: Task) -> None:
        self._n_agents = task.spec.n_agents
        self._in_body = task.spec.observation.in_body_frame
        self._columns = _message_columns(task)

    def of(self, step: Step) -> Double:
        """Returns what each robot has heard of each, of itself where it is, [E, N, N, 5]."""
        n = self._n_agents
        robots = robots_of(step.states, n).astype(np.float64)  # [E, N, 8]
        heard: Double = np.zeros((len(robots), n, n, len(_TOLD)))
        if self._columns is not None:
            told = step.observations[..., self._columns].astype(np.float64)  # [E, N, N-1, 5]
            if self._in_body:
                told = _in_world(told, robots[..., UX], robots[..., UY])
            told[..., HEARD_X::2] += robots[:, :, None, X : X + 1]
            told[..., HEARD_Y::2] += robots[:, :, None, Y : Y + 1]
            for i in range(n):
                others = [j for j in range(n) if j != i]
                heard[:, i, others] = told[:, i]
        every = np.arange(n)
        heard[:, every, every, MASK] = 1.0
        heard[:, every, every, HEARD_X : HEARD_Y + 1] = robots[..., X : Y + 1]
        heard[:, every, every, TARGET_X : TARGET_Y + 1] = robots[..., TX : TY + 1]
        return heard


def _message_columns(task: Task) -> Int | None:
    """Columns of `_TOLD` in an observation for each slot, [N-1, 5]; None if messages lack them."""
    names = [feature.name for feature in features_of(task)]
    slots = [[f"message_{k}.{part}" for part in _TOLD] for k in range(task.spec.n_agents - 1)]
    if not slots or not set(slots[0]) <= set(names):
        return None
    return np.array([[names.index(name) for name in slot] for slot in slots], dtype=np.int64)


def _in_world(told: Double, ux: Double, uy: Double) -> Double:
    """Rotates the vectors of messages from the receivers' body frames into the world's."""
    c, s, out = ux[:, :, None], uy[:, :, None], told.copy()
    for x in (HEARD_X, TARGET_X):
        out[..., x] = c * told[..., x] - s * told[..., x + 1]
        out[..., x + 1] = s * told[..., x] + c * told[..., x + 1]
    return out
