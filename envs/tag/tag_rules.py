"""The rules of `tag`: its two sides, what captures the evader, and reward weights."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Literal

from swarmdata.envs.pursuit.pursuit_rules import PursuitRewards
from swarmdata.specs.quantities import Count, Length
from swarmdata.specs.rules import Side, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


class TagRules(TaskRules):
    """`tag`: pursuers against one evader, the last robot of the team."""

    card_limits: ClassVar[tuple[str, ...]] = (
        "Robots measure the places and velocities of all others exactly.",
        "The evader wins at the horizon, which its observation does not show.",
    )
    naive_teams: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "tag-greedy": "each pursuer drives straight at the evader",
            "tag-lead-3": "each pursuer aims up to 3 s ahead of it",
        }
    )
    side_names: ClassVar[tuple[str, ...]] = ("pursuers", "evader")

    task: Literal["tag"] = "tag"
    captors: Count = 3  # pursuers that capture the evader, at the same time
    capture_radius: Length = 0.45  # m between centres, within which pursuers capture the evader
    start_size: Length = 1.0  # m, side of the square in a corner in which pursuers start
    rewards: PursuitRewards = PursuitRewards.defaults()  # weights of the terms

    def sides(self, spec: "TaskSpec") -> tuple[Side, ...]:
        last, (pursuers, evader) = spec.n_agents - 1, self.side_names
        return Side(pursuers, range(last)), Side(evader, range(last, last + 1))

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        return TaskDemand(columns=0)
