"""The rules of `intersection`: arms, schedules, and reward weights."""

from typing import TYPE_CHECKING, ClassVar, Literal

from swarmdata.specs.quantities import Count, Duration, Length, Weight
from swarmdata.specs.rules import CrowdedRewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


class IntersectionRewards(CrowdedRewards):
    """Weights of `intersection`."""

    progress: Weight = 0.5  # per metre by which a robot's path to its target gets shorter
    entry: Weight = 0.5  # per trip that a robot begins
    crossing: Weight = 2.0  # per trip that a robot ends


class IntersectionRules(TaskRules):
    """`intersection`: robots cross from arm to arm on schedules, without a right of way.

    Solid corners fill what the arena leaves of the four arms; `junction` has a drawing.
    """

    card_limits: ClassVar[tuple[str, ...]] = (
        "The floor is the same in every episode: a policy can memorize the lanes.",
        "Robots that have left by an exit stay in the world and enter again at the next gate, "
        "so the traffic in an arm is that of the team itself.",
    )

    task: Literal["intersection"] = "intersection"
    arm_width: Length = 0.8  # m, of each arm; two robots can pass each other in it
    headway: Duration = 6.0  # s between the trips of a robot's schedule
    goal_radius: Length = 0.15  # m, within which a gate is reached
    quota: Count = 10  # crossings of the team that solve the task
    rewards: IntersectionRewards = IntersectionRewards.defaults()  # weights of the terms

    @property
    def has_own_targets(self) -> bool:
        return True

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        return TaskDemand(obstacles=4, columns=16 + 6 * spec.n_agents)
