"""The rules of `search`: victims, what robots see, and reward weights."""

import math
from typing import TYPE_CHECKING, ClassVar, Literal

from swarmdata.specs.quantities import Count, Length, Weight
from swarmdata.specs.rules import CrowdedRewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


class SearchRewards(CrowdedRewards):
    """Weights of `search`."""

    progress: Weight = 0.5  # per metre by which a robot comes closer to the victim that it knows
    sighting: Weight = 0.5  # per victim that a robot sees for the first time
    rescue: Weight = 2.0  # to every robot, per victim that is rescued
    searched: Weight = 0.05  # per square that a robot has searched


class SearchRules(TaskRules):
    """`search`: robots find victims among walls, and each victim needs several of them."""

    card_limits: ClassVar[tuple[str, ...]] = (
        "Robots notice everything within their sight range that no obstacle hides; nothing is "
        "overlooked and nothing is mistaken for a victim.",
        "Robots remember perfectly which victims they have seen and which squares they have "
        "searched.",
    )

    task: Literal["search"] = "search"
    victims: Count = 4  # victims at unknown places
    helpers: Count = 2  # robots that a victim needs at the same time
    sight_range: Length = 1.2  # m between centres, within which robots see victims
    goal_radius: Length = 0.3  # m, within which a victim is reached; `helpers` robots must fit
    cell_size: Length = 0.75  # m, of the squares in which a robot remembers what it has searched
    rewards: SearchRewards = SearchRewards.defaults()  # weights of the terms

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        rows, columns = (
            math.ceil(size / self.cell_size) for size in (spec.arena.height, spec.arena.width)
        )
        per_robot = self.victims + rows * columns
        return TaskDemand(columns=3 * self.victims + spec.n_agents * per_robot)
