"""The rules of `transport`: the payload, its goal, and reward weights."""

import math
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from swarmdata.specs.quantities import Angle, Distance, Length, Weight
from swarmdata.specs.rules import Payload, Rewards, TaskRules


class TransportRewards(Rewards):
    """Weights of `transport`."""

    progress: Weight = 4.0  # per metre that the payload comes closer to its goal
    turn_progress: Weight = 1.0  # per unit of the sine of its angle to the goal's direction
    approach: Weight = 0.5  # per metre that a robot comes closer to the payload
    robot_contact: Weight = 0.05  # pushing side by side, robots brush against each other
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.2
    obstacle_collision: Weight = 0.5


class TransportRules(TaskRules):
    """`transport`: robots push a payload that none can move alone to a goal pose."""

    payload_field: ClassVar[str] = "payload"
    card_limits: ClassVar[tuple[str, ...]] = (
        "Robots push with their bodies and can neither grip nor pull, so a payload in a "
        "corner can hardly be freed.",
        "Contacts with the payload are not in `events`. Robots that push side by side often "
        "touch each other, and these contacts count as collisions.",
    )

    task: Literal["transport"] = "transport"
    payload: Payload = Payload.defaults()  # what is pushed
    goal_radius: Length = 0.15  # m, of the payload's centre
    goal_angle: Angle | None = None  # rad, of a box; None: any direction will do
    room: Distance = 0.35  # m free around the payload's bounding circle at the start
    rewards: TransportRewards = TransportRewards.defaults()  # weights of the terms

    @model_validator(mode="after")
    def _check_angle(self) -> Self:
        if self.goal_angle is not None and self.payload.shape == "circle":
            raise ValueError("goal_angle needs a box: a circle looks the same in every direction")
        if self.goal_angle is not None and self.goal_angle > math.pi / 2:
            raise ValueError(
                f"goal_angle is {self.goal_angle:g} rad, expected at most pi / 2: a box looks the "
                "same after half a turn"
            )
        return self
