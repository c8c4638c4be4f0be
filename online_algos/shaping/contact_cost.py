"""ContactCost, extra costs of contacts that grow during training."""

from collections.abc import Sequence

import numpy as np

from swarmdata.specs.rules import Rewards
from swarmdata.types import Float, Step


class ContactCost:
    """Subtracts c(p) times the task's own costs of contacts and collisions.

        c(p) = cost clip((p - begin) / (end - begin), 0, 1)      p: part of the training done

    A high cost from the start prevents learning; a low one leaves a policy that brushes past
    obstacles.

    Args:
        weights: of the task's rewards, with the costs of contacts and collisions.
        cost: the factor at the end.
        ramp: begin and end.
    """

    def __init__(self, weights: Rewards, cost: float, ramp: Sequence[float]) -> None:
        self.cost, (self.begin, self.end) = cost, ramp
        self.task_costs = np.array(
            [
                weights.robot_contact, weights.obstacle_contact,
                weights.robot_collision, weights.obstacle_collision,
            ],
            np.float32,
        )  # [4], as `types.EVENTS`  # fmt: skip

    def apply(self, rewards: Float, before: Step, after: Step, progress: float) -> Float:
        """Returns the rewards less the present cost of `after.events`, [E, N]."""
        done = (progress - self.begin) / (self.end - self.begin)
        factor = self.cost * min(1.0, max(0.0, done))
        changed: Float = rewards - factor * (after.events @ self.task_costs)
        return changed
