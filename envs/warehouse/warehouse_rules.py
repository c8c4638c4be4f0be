"""The rules of `warehouse`: its floor, its orders, and reward weights."""

from typing import TYPE_CHECKING, ClassVar, Literal

from swarmdata.specs.quantities import Count, Length, Weight
from swarmdata.specs.rules import CrowdedRewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


class WarehouseRewards(CrowdedRewards):
    """Weights of `warehouse`."""

    progress: Weight = 0.5  # per metre by which a robot's shortest path to its target gets shorter
    pickup: Weight = 1.0  # per order that a robot picks up
    delivery: Weight = 2.0  # per order that a robot delivers


class WarehouseRules(TaskRules):
    """`warehouse`: robots fetch goods from shelves and deliver them at stations.

    Shelves fill what the arena leaves of aisles, lanes and front; `floor_plan` has a drawing.
    """

    card_limits: ClassVar[tuple[str, ...]] = (
        "Shelves and aisles are the same in every episode: a policy can memorize the layout.",
        "Every robot observes the next corner of its own shortest path, which ignores the "
        "other robots.",
    )

    task: Literal["warehouse"] = "warehouse"
    aisles: Count = 3  # one above the other, each with a row of shelves below
    blocks: Count = 1  # of shelves in a row
    aisle_width: Length = 0.65  # m; below two robots abreast, they cannot pass each other
    lane_width: Length = 0.7  # m, of the lanes between blocks and at both ends of the rows
    front: Length = 0.8  # m, depth of the free strip with the stations
    bays: Count = 4  # pick places on each side of an aisle, for each block
    stations: Count = 4  # places to deliver at
    goal_radius: Length = 0.15  # m, within which a place is reached
    quota: Count = 8  # deliveries of the team that solve the task
    rewards: WarehouseRewards = WarehouseRewards.defaults()  # weights of the terms

    @property
    def has_own_targets(self) -> bool:
        return True

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        shelves = self.aisles * self.blocks
        return TaskDemand(
            obstacles=shelves,
            places=2 * shelves * self.bays + self.stations,
            columns=16 + 6 * spec.n_agents,
        )
