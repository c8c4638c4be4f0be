"""Who keeps to the right: a cost that gives robots one convention for meeting head on."""

import numpy as np

from swarmdata.encounters import MOVING, OPPOSED, REACH
from swarmdata.states import VX, VY, X, Y, robots_of
from swarmdata.types import Float, Step


def on_the_wrong_side(step: Step) -> Float:
    """Returns how many oncoming robots each robot has on its right, [E, N].

    Robots are oncoming while they are closer than `encounters.REACH`, both move, their velocities
    point against each other, and they have not passed. Who keeps to the right has them on its left.
    """
    robots = robots_of(step.states, step.rewards.shape[1])
    places, speeds = robots[..., [X, Y]], robots[..., [VX, VY]]
    gap = places[:, None] - places[:, :, None]  # [E, i, j, 2], from i to j
    norms = np.sqrt(np.square(speeds).sum(-1))
    products = (speeds[:, :, None] * speeds[:, None]).sum(-1)
    moving = (norms > MOVING)[:, :, None] & (norms > MOVING)[:, None]
    opposed = products < OPPOSED * norms[:, :, None] * norms[:, None]
    near = np.square(gap).sum(-1) < REACH**2
    ahead = (gap * speeds[:, :, None]).sum(-1) > 0
    side = speeds[:, :, None, 0] * gap[..., 1] - speeds[:, :, None, 1] * gap[..., 0]
    wrong = moving & opposed & near & ahead & (side < 0)
    return wrong.sum(-1).astype(np.float32)
