"""PassingSide, a cost of oncoming robots on one side, which teaches a convention."""

import numpy as np

from swarmdata.analysis.passings import ENCOUNTER_DISTANCE, HEAD_ON_MAX_COSINE, MOVING_MIN_SPEED
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.types import Float, Step


class PassingSide:
    """Subtracts a cost for each oncoming robot, in each step.

    A robot that keeps to the right has oncoming robots on its left, so a cost of those on the right
    teaches it to keep right.

    Args:
        right_cost: of an oncoming robot on the right.
        left_cost: of one on the left.
    """

    def __init__(self, right_cost: float, left_cost: float) -> None:
        self.right_cost, self.left_cost = np.float32(right_cost), np.float32(left_cost)

    def apply(self, rewards: Float, before: Step, after: Step, progress: float) -> Float:
        """Returns the rewards less the costs in `after`, [E, N]."""
        n_right, n_left = count_oncoming(after)
        changed: Float = rewards - (self.right_cost * n_right + self.left_cost * n_left)
        return changed


def count_oncoming(step: Step) -> tuple[Float, Float]:
    """Returns how many oncoming robots each robot has on its right and on its left, each [E, N].

    Two robots are oncoming while they are closer than `passings.ENCOUNTER_DISTANCE`, both move,
    their velocities point against each other, and they have not passed. A robot exactly ahead is on
    neither side.
    """
    robots = robots_of(step.states, step.rewards.shape[1])
    positions, velocities = robots[..., [X, Y]], robots[..., [VX, VY]]
    gap = positions[:, None] - positions[:, :, None]  # [E, i, j, 2], from i to j
    speeds = np.sqrt(np.square(velocities).sum(-1))
    products = (velocities[:, :, None] * velocities[:, None]).sum(-1)
    moving = (speeds > MOVING_MIN_SPEED)[:, :, None] & (speeds > MOVING_MIN_SPEED)[:, None]
    opposed = products < HEAD_ON_MAX_COSINE * speeds[:, :, None] * speeds[:, None]
    near = np.square(gap).sum(-1) < ENCOUNTER_DISTANCE**2
    ahead = (gap * velocities[:, :, None]).sum(-1) > 0
    side = velocities[:, :, None, 0] * gap[..., 1] - velocities[:, :, None, 1] * gap[..., 0]
    oncoming = moving & opposed & near & ahead
    n_right = (oncoming & (side < 0)).sum(-1).astype(np.float32)
    n_left = (oncoming & (side > 0)).sum(-1).astype(np.float32)
    return n_right, n_left
