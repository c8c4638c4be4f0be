"""The rules of each task: the part of a spec that only this task has, with its reward weights.

Lengths are metres, times seconds, speeds metres per second, angles radians.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import (
    Field,
    SerializeAsAny,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from swarmdata.errors import UnknownNameError
from swarmdata.runtime.own_components import components, import_component
from swarmdata.specs.frozen import Frozen, Probability
from swarmdata.specs.quantities import (
    Angle,
    Coordinate,
    Count,
    Distance,
    Duration,
    Force,
    Length,
    Mass,
    Speed,
    Weight,
)

Rank = Annotated[int, Field(ge=0, le=10**12)]

Previews = Annotated[tuple[Duration, ...], Field(max_length=64)]


class Rewards(Frozen):
    """Reward weights that all tasks share; each task adds those of its own terms."""

    success: Weight = 3.0  # once, to every robot, when the task is solved
    time: Weight = 0.02  # per step in which the robot has not done its part
    robot_contact: Weight = 0.4  # per step in contact with a robot
    obstacle_contact: Weight = 0.4  # per step in contact with an obstacle or wall
    robot_collision: Weight = 1.0  # per contact with a robot that begins
    obstacle_collision: Weight = 1.0  # per contact with an obstacle or wall that begins
    proximity: Weight = 0.05  # per step, times how deep in the last 0.1 m before contact
    team_share: Probability = 0.0  # part of each reward that is the mean over the team


def changed_weights(weights: Rewards, changes: Mapping[str, float | str]) -> Rewards:
    """Returns the same weights with some of them changed.

    Args:
        weights: of a task.
        changes: new values by name, as numbers or as text.

    Raises:
        UnknownNameError: there is no weight of that name; the message lists those that exist.
        SpecError: a weight cannot have the value.
    """
    for name in changes:
        if name not in type(weights).model_fields:
            raise UnknownNameError("reward weight", name, type(weights).model_fields)
    return type(weights).parse({**weights.model_dump(), **changes}, "rewards")


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


AnyArrangement = Annotated[
    RandomArrangement | Swap | Doorway | Corridor | Lanes | Ranks, Field(discriminator="kind")
]


class NavigationRules(Frozen):
    """`coop_nav`: robots drive to goals."""

    task: Literal["coop_nav"] = "coop_nav"
    goals: Literal["assigned", "unassigned"] = "assigned"  # unassigned: all must be covered
    arrangement: AnyArrangement = RandomArrangement()  # of obstacles, starts and goals
    goal_radius: Length = 0.15  # m, within which a goal is reached
    rewards: NavigationRewards = NavigationRewards()  # weights of the terms

    @property
    def has_own_targets(self) -> bool:
        """Whether each robot has a target that the other robots do not change."""
        return self.goals == "assigned"


class FormationRewards(Rewards):
    """Weights of `formation`."""

    deviation: Weight = 0.05  # per step and metre of distance to the own slot, up to 1 m
    velocity: Weight = 0.01  # per step in the slot and m/s of difference to its velocity


class FormationRules(Frozen):
    """`formation`: robots reach and hold a shape whose reference moves through the arena."""

    task: Literal["formation"] = "formation"
    shape: Literal["line", "circle", "wedge", "column"] = "wedge"  # of the slots
    spacing: Length = 0.5  # m between neighbouring slots
    slots: Literal["fixed", "assigned"] = "assigned"  # assigned: the best assignment in each step
    reference_speed: Speed = 0.28  # m/s, never exceeded
    segment_time: Duration = 4.0  # s between the control points of the path
    max_turn: Annotated[float, Field(ge=0, le=1.2)] = 0.8  # rad from one control edge to the next
    path_clearance: Distance = 0.3  # m, from the reference's path to every obstacle
    blocked: tuple[Probability, Probability] = (0.1, 0.3)  # share of time with a slot in obstacles
    start_spread: Distance = 1.0  # m beyond the slots in which robots start
    preview: Previews = (1.0, 2.0)  # s ahead at which robots see their slots
    tolerance: Length = 0.12  # m, root mean square deviation that counts as in formation
    hold_fraction: Annotated[float, Field(gt=0, le=1)] = 0.6  # of the horizon in formation to solve
    rewards: FormationRewards = FormationRewards()  # weights of the terms

    @property
    def has_own_targets(self) -> bool:
        """Whether each robot has a target that the other robots do not change."""
        return self.slots == "fixed"


class Payload(Frozen):
    """A rigid body that slides on the floor and turns."""

    shape: Literal["circle", "box"] = "circle"  # a box has faces and can be turned
    half_length: Length = 0.35  # radius of a circle
    half_width: Length = 0.25  # m, of a box
    mass: Mass = 4.0  # kg
    friction: Force = 2.5  # N, of the floor; one robot pushes with mass 1 kg times acceleration


class TransportRewards(Rewards):
    """Weights of `transport`."""

    progress: Weight = 4.0  # per metre that the payload comes closer to its goal
    turn_progress: Weight = 1.0  # per unit of the sine of its angle to the goal's direction
    approach: Weight = 0.5  # per metre that a robot comes closer to the payload
    robot_contact: Weight = 0.05  # pushing side by side, robots brush against each other
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.2
    obstacle_collision: Weight = 0.5


class TransportRules(Frozen):
    """`transport`: robots push a payload that none can move alone to a goal pose."""

    task: Literal["transport"] = "transport"
    payload: Payload = Payload()  # what is pushed
    goal_radius: Length = 0.15  # m, of the payload's centre
    goal_angle: Angle | None = None  # rad, of a box; None: any direction will do
    room: Distance = 0.35  # m free around the payload's bounding circle at the start
    rewards: TransportRewards = TransportRewards()  # weights of the terms
    has_own_targets: ClassVar[bool] = False  # the payload's goal is that of all robots

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


class WarehouseRewards(Rewards):
    """Weights of `warehouse`."""

    progress: Weight = 0.5  # per metre by which a robot's shortest path to its target gets shorter
    pickup: Weight = 1.0  # per order that a robot picks up
    delivery: Weight = 2.0  # per order that a robot delivers
    robot_contact: Weight = 0.2
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.5
    obstacle_collision: Weight = 0.5
    proximity: Weight = 0.005  # robots that pass in an aisle cannot keep 0.1 m from everything


class WarehouseRules(Frozen):
    """`warehouse`: robots fetch goods from shelves and deliver them at stations.

    Shelves fill what the arena leaves of aisles, lanes and front; `envs.floor_plan` has a drawing.
    """

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
    rewards: WarehouseRewards = WarehouseRewards()  # weights of the terms
    has_own_targets: ClassVar[bool] = True  # each robot has orders of its own


class IntersectionRewards(Rewards):
    """Weights of `intersection`."""

    progress: Weight = 0.5  # per metre by which a robot's path to its target gets shorter
    entry: Weight = 0.5  # per trip that a robot begins
    crossing: Weight = 2.0  # per trip that a robot ends
    robot_contact: Weight = 0.2
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.5
    obstacle_collision: Weight = 0.5
    proximity: Weight = 0.005  # robots that pass in an arm cannot keep 0.1 m from everything


class IntersectionRules(Frozen):
    """`intersection`: robots cross from arm to arm on schedules, without a right of way.

    Solid corners fill what the arena leaves of the four arms; `envs.junction` has a drawing.
    """

    task: Literal["intersection"] = "intersection"
    arm_width: Length = 0.8  # m, of each arm; two robots can pass each other in it
    headway: Duration = 6.0  # s between the trips of a robot's schedule
    goal_radius: Length = 0.15  # m, within which a gate is reached
    quota: Count = 10  # crossings of the team that solve the task
    rewards: IntersectionRewards = IntersectionRewards()  # weights of the terms
    has_own_targets: ClassVar[bool] = True  # each robot has trips of its own


class SearchRewards(Rewards):
    """Weights of `search`."""

    progress: Weight = 0.5  # per metre by which a robot comes closer to the victim that it knows
    sighting: Weight = 0.5  # per victim that a robot sees for the first time
    rescue: Weight = 2.0  # to every robot, per victim that is rescued
    searched: Weight = 0.05  # per square that a robot has searched
    robot_contact: Weight = 0.2
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.5
    obstacle_collision: Weight = 0.5
    proximity: Weight = 0.005  # two robots at one victim are close to each other


class SearchRules(Frozen):
    """`search`: robots find victims among walls, and each victim needs several of them."""

    task: Literal["search"] = "search"
    victims: Count = 4  # victims at unknown places
    helpers: Count = 2  # robots that a victim needs at the same time
    sight_range: Length = 1.2  # m between centres, within which robots see victims
    goal_radius: Length = 0.3  # m, within which a victim is reached; `helpers` robots must fit
    cell_size: Length = 0.75  # m, of the squares in which a robot remembers what it has searched
    rewards: SearchRewards = SearchRewards()  # weights of the terms
    has_own_targets: ClassVar[bool] = False  # robots rescue each other's victims


PackageRules = (
    NavigationRules
    | FormationRules
    | TransportRules
    | WarehouseRules
    | IntersectionRules
    | SearchRules
)
"""The rules of the package's tasks."""

PACKAGE_TASKS = frozenset(model.model_fields["task"].default for model in get_args(PackageRules))


def _own_rules(value: Any, read: ValidatorFunctionWrapHandler) -> Any:
    """Reads the rules of a user's task with the model that the task has as `Rules`.

    Users cannot replace the package's tasks, so those need no search through what is installed,
    which takes longer than all else of opening a dataset.
    """
    is_mapping = isinstance(value, Mapping)
    task = value.get("task") if is_mapping else getattr(value, "task", None)
    if not isinstance(task, str) or task in PACKAGE_TASKS:
        return read(value)
    own = components("tasks")
    if task not in own:
        return read(value)
    model = import_component(own[task]).Rules
    return model.model_validate(value) if is_mapping else value


Rules = Annotated[
    SerializeAsAny[Annotated[PackageRules, Field(discriminator="task")]],
    WrapValidator(_own_rules),
]
"""The rules of one of the package's tasks, or of a task that users have registered."""
