"""The rules of `coop_nav`: goals, arrangements of starts and goals, and reward weights."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from swarmdata.specs.frozen import Frozen
from swarmdata.specs.quantities import Coordinate, Distance, Length, Weight
from swarmdata.specs.rules import Rewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


LANE_CONVENTIONS = ("keep-right", "keep-left")

GOAL_CONVENTIONS = ("by-x", "by-y")

Rank = Annotated[int, Field(ge=0, le=10**12)]


class NavigationRewards(Rewards):
    """Weights of `coop_nav`."""

    progress: Weight = 2.0  # per metre that a robot comes closer; see `envs.coop_nav`


class RandomArrangement(Frozen):
    """Obstacles, starts and goals drawn at random, within `Obstacles` and `Spawn`."""

    kind: Literal["random"] = "random"


class Swap(Frozen):
    """Robots on a circle about the origin, turned by a random angle, with goals opposite."""

    kind: Literal["swap"] = "swap"
    circle_radius: Length = 1.5  # m
    jitter: Distance = 0.1  # m, of each start in x and in y, before the turn


class Doorway(Frozen):
    """Two teams left and right of a wall across the arena swap sides through its one door."""

    kind: Literal["doorway"] = "doorway"
    width: Length = 0.5  # m, of the door, in the middle of the wall
    thickness: Length = 0.2  # m, of the wall
    jitter: Distance = 0.1  # m, of each start in x and in y


class Corridor(Frozen):
    """Two teams at the ends of a straight corridor swap ends."""

    kind: Literal["corridor"] = "corridor"
    width: Length = 0.8  # m; two robots must fit side by side
    length: Length = 1.6  # m
    jitter: Distance = 0.1  # m, of each start in x and in y


class Lanes(Frozen):
    """Two teams swap ends through two parallel lanes, in each of which one robot fits."""

    kind: Literal["lanes"] = "lanes"
    width: Length = 0.46  # m, of each lane
    length: Length = 1.8  # m
    spread: Length = 1.0  # m between the middles of the lanes
    rows: tuple[Coordinate, Coordinate] = (-0.25, 0.25)  # m, y of the left and the right team
    jitter: Distance = 0.1  # m, of each start in x and in y


class Ranks(Frozen):
    """A row of robots below N goals, of which no two have the same rank along x or along y.

    Goal k is the k-th from the left and has rank `order[k]` from the bottom, both from 0.
    """

    kind: Literal["ranks"] = "ranks"
    order: Annotated[tuple[Rank, ...], Field(min_length=1, max_length=1024)] = (2, 0, 3, 1)
    """Rank of each goal along y."""
    spacing: Length = 0.75  # m between neighbouring ranks, and between robots in their row
    distance: Length = 1.0  # m from the row to the lowest goal, along y
    jitter: Distance = 0.1  # m, of each start and goal in x and in y


Cells = Annotated[str, Field(pattern=r"^[.@]+$", max_length=1024)]


class GridMap(Frozen):
    """Walls on a grid; starts and goals are drawn in the largest connected part of the free cells.

    Raises:
        SpecError: rows differ in length.
    """

    kind: Literal["map"] = "map"
    rows: Annotated[tuple[Cells, ...], Field(min_length=1, max_length=1024)]
    """The first at the top; `.` is free, `@` a wall."""
    cell: Length = 0.7  # m, side of a cell

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len({len(row) for row in self.rows}) > 1:
            raise ValueError("rows of a map have different lengths, expected the same")
        return self


AnyArrangement = Annotated[
    RandomArrangement | Swap | Doorway | Corridor | Lanes | Ranks | GridMap,
    Field(discriminator="kind"),
]


class NavigationRules(TaskRules):
    """`coop_nav`: robots drive to goals."""

    card_limits: ClassVar[tuple[str, ...]] = (
        "Obstacles are static; the other robots are the only moving obstacles.",
        "Robots that have arrived stay in the world and obstruct the others.",
    )

    task: Literal["coop_nav"] = "coop_nav"
    goals: Literal["assigned", "unassigned"] = "assigned"  # unassigned: all must be covered
    arrangement: AnyArrangement = RandomArrangement.defaults()  # of obstacles, starts and goals
    goal_radius: Length = 0.15  # m, within which a goal is reached
    rewards: NavigationRewards = NavigationRewards.defaults()  # weights of the terms

    @property
    def conventions(self) -> tuple[str, ...]:
        if self.arrangement.kind == "lanes":
            return LANE_CONVENTIONS
        return GOAL_CONVENTIONS if self.goals == "unassigned" else ()

    @property
    def has_own_targets(self) -> bool:
        return self.goals == "assigned"

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        n, is_shared = spec.n_agents, self.goals == "unassigned"
        return TaskDemand(
            obstacles=self._n_walls(),
            features=8 * n if is_shared else 24,
            columns=2 * n if is_shared else 16 + 6 * n,
            is_matched=is_shared,
            is_drawn=self.arrangement.kind in ("random", "map"),
        )

    def _n_walls(self) -> int:
        """Obstacles of the arrangement; of a map, at most as many."""
        if isinstance(self.arrangement, GridMap):
            return sum(row.count("@") for row in self.arrangement.rows)
        return {"doorway": 2, "corridor": 2, "lanes": 3}.get(self.arrangement.kind, 0)
