"""The rewards that MAPPO trains on: the task's, with costs that train careful drivers."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.online_algos.shaping.passing_side import oncoming
from swarmdata.specs.rules import Rewards
from swarmdata.types import Float, Step


@dataclass(frozen=True, slots=True)
class Shaping:
    """What is changed in a task's rewards.

    Raises:
        SchemaError: the ramp has not two ends, the later one last, or the share is not a part.
    """

    contact_cost: float  # how much of each contact cost of the task is added at last
    contact_ramp: tuple[float, ...]  # part of training in which that grows from 0: begin, end
    keep_right: float  # cost of each oncoming robot on the right, in each step
    keep_left: float  # the same on the left
    team_share: float  # part of each reward that is the team's mean

    def __post_init__(self) -> None:
        """Checks the numbers."""
        if len(self.contact_ramp) != 2 or self.contact_ramp[0] >= self.contact_ramp[1]:
            raise SchemaError(
                f"contact_ramp is {self.contact_ramp}, expected two parts of training, begin "
                "before end, such as 0.2,0.75; for the whole cost from the start, -1,0"
            )
        if not 0 <= self.team_share <= 1:
            raise SchemaError(f"team_share is {self.team_share}, expected a part, 0 to 1")

    @classmethod
    def of(cls, config: Any) -> "Shaping":
        """Reads the fields of the same names from an algorithm's config."""
        names = ("contact_cost", "contact_ramp", "keep_right", "keep_left", "team_share")
        return cls(*(getattr(config, name) for name in names))

    def rewards(self, step: Step, weights: Rewards, progress: float) -> Float:
        """Returns each robot's reward to train on, float32 [E, N].

        Args:
            step: what was reached, with the task's rewards and the contacts on the way.
            weights: the task's, with the costs of contacts and collisions.
            progress: part of the training that is done, in [0, 1].
        """
        costs = np.array(
            [
                weights.robot_contact, weights.obstacle_contact,
                weights.robot_collision, weights.obstacle_collision,
            ],
            np.float32,
        )  # fmt: skip
        rewards = step.rewards - self._extra(progress) * (step.events @ costs)
        if self.keep_right or self.keep_left:
            right, left = oncoming(step)
            cost = np.float32(self.keep_right) * right + np.float32(self.keep_left) * left
            rewards = rewards - cost
        share = self.team_share
        mixed: Float = (1 - share) * rewards + share * rewards.mean(1, keepdims=True)
        return mixed

    def _extra(self, progress: float) -> float:
        """Present factor on the costs of contacts."""
        begin, end = self.contact_ramp
        return self.contact_cost * min(1.0, max(0.0, (progress - begin) / (end - begin)))
