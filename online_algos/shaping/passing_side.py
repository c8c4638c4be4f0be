"""On which side oncoming robots are: what a convention for meeting head on is about."""

import numpy as np

from swarmdata.analysis.passings import ENCOUNTER_DISTANCE, HEAD_ON_MAX_COSINE, MOVING_MIN_SPEED
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.types import Float, Step


def oncoming(step: Step) -> tuple[Float, Float]:
    """Returns how many oncoming robots each robot has on its right and on its left, each [E, N].

    Robots are oncoming while they are closer than `passings.ENCOUNTER_DISTANCE`, both move, their
    velocities point against each other, and they have not passed. Who keeps to the right has them
    on its left. Exactly ahead is on neither side.
    """
    robots = robots_of(step.states, step.rewards.shape[1])
    places, speeds = robots[..., [X, Y]], robots[..., [VX, VY]]
    gap = places[:, None] - places[:, :, None]  # [E, i, j, 2], from i to j
    norms = np.sqrt(np.square(speeds).sum(-1))
    products = (speeds[:, :, None] * speeds[:, None]).sum(-1)
    moving = (norms > MOVING_MIN_SPEED)[:, :, None] & (norms > MOVING_MIN_SPEED)[:, None]
    opposed = products < HEAD_ON_MAX_COSINE * norms[:, :, None] * norms[:, None]
    near = np.square(gap).sum(-1) < ENCOUNTER_DISTANCE**2
    ahead = (gap * speeds[:, :, None]).sum(-1) > 0
    side = speeds[:, :, None, 0] * gap[..., 1] - speeds[:, :, None, 1] * gap[..., 0]
    meeting = moving & opposed & near & ahead
    right, left = ((meeting & there).sum(-1).astype(np.float32) for there in (side < 0, side > 0))
    return right, left
