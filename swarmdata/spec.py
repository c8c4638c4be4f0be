"""TaskSpec, the whole problem as frozen data, and Recipe, all that makes a dataset again.

Two equal specs give the same world; two equal recipes give the same dataset.

Lengths are metres, times seconds, speeds metres per second, angles radians.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from swarmdata.errors import SpecError, did_you_mean

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Span = tuple[Positive, Positive]


class Frozen(BaseModel):
    """A frozen pydantic model that refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def parse(cls, data: Any, source: str = "") -> Self:
        """Builds the model from plain data.

        Raises:
            SpecError: one message naming the path of every wrong key or value.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            where = f" in {source}" if source else ""
            problems = "; ".join(_explain(cls, problem) for problem in error.errors())
            raise SpecError(f"invalid {cls.__name__}{where}: {problems}") from error

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no spaces, every default written out."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))

    def to_yaml(self) -> str:
        """The same content as readable YAML, in field order."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)

    def hash(self) -> str:
        """SHA-256 of the canonical JSON, hex; stable across processes and platforms."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()

    @classmethod
    def from_text(cls, text: str, source: str = "text") -> Self:
        """Builds the model from YAML or JSON text (JSON is YAML); duplicate keys are refused."""
        try:
            data = yaml.load(text, Loader=_UniqueKeyLoader)
        except yaml.YAMLError as error:
            raise SpecError(f"{source} is neither YAML nor JSON: {error}") from error
        return cls.parse(data, source)

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """Builds the model from a `.yaml` or `.json` file."""
        return cls.from_text(Path(path).read_text(encoding="utf-8"), str(path))


class Robot(Frozen):
    """One kind of circular robot of mass 1 kg."""

    radius: Positive = 0.12
    dynamics: Literal["holonomic", "unicycle"] = "holonomic"
    command: Literal["velocity", "acceleration"] = "velocity"
    max_speed: Positive = 0.6
    max_acceleration: Positive = 1.5
    max_turn_rate: Positive = 3.0  # rad/s, unicycle only
    sensor_range: Positive | None = None  # m, of this robot's sensors, if less than the model's


class Role(Frozen):
    """`count` robots of one kind."""

    name: str = "robot"
    count: Annotated[int, Field(ge=1)] = 4
    robot: Robot = Robot()


class Arena(Frozen):
    """A rectangle centred on the origin, inside thick walls."""

    width: Positive = 4.0
    height: Positive = 4.0
    wall_thickness: Positive = 0.3


class Obstacles(Frozen):
    """How many obstacles of each shape are drawn, and how large.

    A corner is an L of two bars, a pocket a U of three; both are traps for a robot that drives
    straight at its goal. Bounding circles stay `gap` apart from each other and from the walls, so
    that every passage is passable and every layout solvable.
    """

    circles: Annotated[int, Field(ge=0)] = 2
    boxes: Annotated[int, Field(ge=0)] = 1
    corners: Annotated[int, Field(ge=0)] = 1
    pockets: Annotated[int, Field(ge=0)] = 2
    circle_radius: Span = (0.12, 0.25)
    box_half_length: Span = (0.12, 0.25)
    corner_half_length: Span = (0.25, 0.4)
    pocket_half_length: Span = (0.3, 0.4)
    bar_half_thickness: Positive = 0.05
    gap: Positive = 0.34


class Spawn(Frozen):
    """Where robots start and where their goals are: distances between surfaces."""

    start_clearance: NonNegative = 0.06
    start_separation: NonNegative = 0.15
    goal_clearance: NonNegative = 0.15
    goal_separation: NonNegative = 0.25
    min_goal_distance: NonNegative = 1.2
    max_attempts: Annotated[int, Field(ge=1)] = 2000


class Rewards(Frozen):
    """Weights that every task has; each task adds those of its own terms."""

    success: NonNegative = 3.0  # once, to every robot, when the task is solved
    time: NonNegative = 0.02  # per step in which the robot has not done its part
    robot_contact: NonNegative = 0.2  # per step in contact with a robot
    obstacle_contact: NonNegative = 0.2  # per step in contact with an obstacle or wall
    robot_collision: NonNegative = 0.5  # per contact with a robot that begins
    obstacle_collision: NonNegative = 0.5  # per contact with an obstacle or wall that begins
    proximity: NonNegative = 0.2  # per step, times how deep in the last 0.1 m before contact
    team_share: Probability = 0.0  # part of each reward that is the mean over the team


class NavigationRewards(Rewards):
    """Weights of `coop_nav`."""

    progress: NonNegative = 2.0  # per metre that a robot comes closer; see `envs.coop_nav`


class RandomArrangement(Frozen):
    """Obstacles, starts and goals anywhere: `Obstacles` and `Spawn` say how many and how close."""

    kind: Literal["random"] = "random"


class Swap(Frozen):
    """Robots on a circle about the origin, turned by a random angle, with goals opposite."""

    kind: Literal["swap"] = "swap"
    circle_radius: Positive = 1.5  # m
    jitter: NonNegative = 0.1  # m, of each start in x and in y, before the turn


class Doorway(Frozen):
    """Two teams left and right of a wall across the arena swap sides through its one door."""

    kind: Literal["doorway"] = "doorway"
    width: Positive = 0.5  # m, of the door, in the middle of the wall
    thickness: Positive = 0.2  # m, of the wall
    jitter: NonNegative = 0.1  # m, of each start in x and in y


class Corridor(Frozen):
    """Two teams at the ends of a straight corridor swap ends."""

    kind: Literal["corridor"] = "corridor"
    width: Positive = 0.8  # m; two robots must fit side by side
    length: Positive = 1.6  # m
    jitter: NonNegative = 0.1  # m, of each start in x and in y


AnyArrangement = Annotated[
    RandomArrangement | Swap | Doorway | Corridor, Field(discriminator="kind")
]


class NavigationRules(Frozen):
    """`coop_nav`: robots drive to goals."""

    task: Literal["coop_nav"] = "coop_nav"
    goals: Literal["assigned", "unassigned"] = "assigned"  # unassigned: all must be covered
    arrangement: AnyArrangement = RandomArrangement()
    goal_radius: Positive = 0.15
    rewards: NavigationRewards = NavigationRewards()


class FormationRewards(Rewards):
    """Weights of `formation`."""

    deviation: NonNegative = 0.05  # per step and metre of distance to the own slot, up to 1 m
    velocity: NonNegative = 0.01  # per step in the slot and m/s of difference to its velocity


class FormationRules(Frozen):
    """`formation`: robots reach and hold a shape whose reference moves through the arena."""

    task: Literal["formation"] = "formation"
    shape: Literal["line", "circle", "wedge", "column"] = "wedge"
    spacing: Positive = 0.5  # m between neighbouring slots
    slots: Literal["fixed", "assigned"] = "assigned"  # assigned: the best assignment in each step
    reference_speed: Positive = 0.28  # m/s, never exceeded
    segment_time: Positive = 4.0  # s between the control points of the path
    max_turn: Annotated[float, Field(ge=0, le=1.2)] = 0.8  # rad from one control edge to the next
    path_clearance: NonNegative = 0.3  # m, from the reference's path to every obstacle
    blocked: tuple[Probability, Probability] = (0.1, 0.3)  # share of time with a slot in obstacles
    start_spread: NonNegative = 1.0  # m beyond the slots in which robots start
    preview: tuple[Positive, ...] = (1.0, 2.0)  # s ahead at which robots see their slots
    tolerance: Positive = 0.12  # m, root mean square deviation that counts as in formation
    hold_fraction: Annotated[float, Field(gt=0, le=1)] = 0.6  # of the horizon in formation to solve
    rewards: FormationRewards = FormationRewards()


class Payload(Frozen):
    """A rigid body that slides on the floor and turns."""

    shape: Literal["circle", "box"] = "circle"
    half_length: Positive = 0.35  # radius of a circle
    half_width: Positive = 0.25
    mass: Positive = 4.0  # kg
    friction: Positive = 2.5  # N, of the floor; one robot pushes with mass 1 kg times acceleration


class TransportRewards(Rewards):
    """Weights of `transport`."""

    progress: NonNegative = 4.0  # per metre that the payload comes closer to its goal
    turn_progress: NonNegative = 1.0  # per unit of the sine of its angle to the goal's direction
    approach: NonNegative = 0.5  # per metre that a robot comes closer to the payload
    robot_contact: NonNegative = 0.05  # pushing side by side, robots brush against each other
    robot_collision: NonNegative = 0.2
    proximity: NonNegative = 0.05


class TransportRules(Frozen):
    """`transport`: robots push a payload that none can move alone to a goal pose."""

    task: Literal["transport"] = "transport"
    payload: Payload = Payload()
    goal_radius: Positive = 0.15  # m, of the payload's centre
    goal_angle: Positive | None = None  # rad, of a box; None: any direction will do
    room: NonNegative = 0.35  # m free around the payload's bounding circle at the start
    rewards: TransportRewards = TransportRewards()

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

    progress: NonNegative = 0.5  # per metre that a robot's shortest way to its target gets shorter
    pickup: NonNegative = 1.0
    delivery: NonNegative = 2.0
    proximity: NonNegative = 0.02  # robots that pass in an aisle cannot keep 0.1 m from everything


class WarehouseRules(Frozen):
    """`warehouse`: robots fetch goods from shelves and deliver them at stations.

    Shelves fill what the arena leaves of aisles, lanes and front; `envs.floor_plan` has a drawing.
    """

    task: Literal["warehouse"] = "warehouse"
    aisles: Annotated[int, Field(ge=1)] = 3  # one above the other, each with a row of shelves below
    blocks: Annotated[int, Field(ge=1)] = 1  # of shelves in a row
    aisle_width: Positive = 0.65  # m; below two robots abreast, they cannot pass each other
    lane_width: Positive = 0.7  # m, of the lanes between blocks and at both ends of the rows
    front: Positive = 0.8  # m, depth of the free strip with the stations
    bays: Annotated[int, Field(ge=1)] = 4  # pick places on each side of an aisle, for each block
    stations: Annotated[int, Field(ge=1)] = 4
    goal_radius: Positive = 0.15
    quota: Annotated[int, Field(ge=1)] = 8  # deliveries of the team that solve the task
    rewards: WarehouseRewards = WarehouseRewards()


Rules = Annotated[
    NavigationRules | FormationRules | TransportRules | WarehouseRules,
    Field(discriminator="task"),
]


class SensorNoise(Frozen):
    """Standard deviations of the Gaussian noise on each kind of feature, anew in each step."""

    position: NonNegative = 0.0  # m, of positions and displacements
    velocity: NonNegative = 0.0  # m/s
    direction: NonNegative = 0.0  # of the components of unit vectors
    range: NonNegative = 0.0  # m, of distances


class ObservationModel(Frozen):
    """What every observation model has: how its returns are worsened, in this order.

    Noise is added to what is sensed; each return (a slot, a beam) is lost with probability
    `dropout`; robots see `delay` steps late; the last `stack` frames are concatenated, newest
    first. Before the first frame there is nothing but that frame. All of it is a function of the
    episode's seed and the step.
    """

    noise: SensorNoise = SensorNoise()
    dropout: Probability = 0.0
    delay: Annotated[int, Field(ge=0)] = 0  # control steps
    stack: Annotated[int, Field(ge=1)] = 1  # frames


class StateModel(ObservationModel):
    """Low-dimensional state in the world's frame: self, nearest robots, nearest obstacles."""

    kind: Literal["state"] = "state"
    n_neighbors: Annotated[int, Field(ge=0)] = 3
    n_obstacles: Annotated[int, Field(ge=0)] = 3
    range: Positive = 1.0  # m, gap at which closeness features reach 0
    limit: Positive | None = None  # m, gap beyond which nothing is seen; None: no limit


class LidarModel(ObservationModel):
    """A range scan with hit types in the body's frame, and the target in polar form."""

    kind: Literal["lidar"] = "lidar"
    n_rays: Annotated[int, Field(ge=1)] = 16
    range: Positive = 2.0  # m from the robot's centre


class BearingModel(ObservationModel):
    """Bearings and ranges of visible neighbours in the body's frame, occluded ones missing."""

    kind: Literal["bearing"] = "bearing"
    n_neighbors: Annotated[int, Field(ge=0)] = 3
    range: Positive = 2.0  # m between centres


class OccupancyModel(ObservationModel):
    """A coarse egocentric grid in the body's frame: which cells hold what."""

    kind: Literal["occupancy"] = "occupancy"
    cells: Annotated[int, Field(ge=1)] = 9  # in each direction
    cell_size: Positive = 0.3  # m


AnyObservationModel = Annotated[
    StateModel | LidarModel | BearingModel | OccupancyModel, Field(discriminator="kind")
]


class NoCommunication(Frozen):
    """Robots do not talk."""

    kind: Literal["none"] = "none"


class Bursts(Frozen):
    """A link's two states after Gilbert (1960) and Elliott (1963): good ones, and bad bursts."""

    enter: Probability = 0.05  # chance per step that a good link turns bad
    leave: Probability = 0.25  # chance per step that a bad link turns good
    drop_probability: Probability = 1.0  # while a link is bad


class Broadcast(Frozen):
    """Each robot broadcasts one message in every step; this says who hears it, and when.

    The order is: quantise, pick the links by topology and range, spend the bandwidth, collide,
    drop, delay.
    """

    kind: Literal["broadcast"] = "broadcast"
    payload: Literal["pose", "pose_and_goal", "state", "learned"] = "pose"
    message_size: Annotated[int, Field(ge=1)] = 4  # values of a learned message
    topology: Literal["full", "nearest", "ring", "star"] = "full"
    n_nearest: Annotated[int, Field(ge=1)] = 2  # of topology "nearest"
    range: Positive | None = None  # m between centres; None: no limit
    drop_probability: Probability = 0.0
    bursts: Bursts | None = None
    delay: Annotated[int, Field(ge=0)] = 0  # control steps
    messages_per_step: Annotated[int, Field(ge=1)] | None = None  # that a robot can receive
    bits: Annotated[int, Field(ge=1, le=24)] | None = None  # of each value of a message
    slots_in_step: Annotated[int, Field(ge=1)] | None = None  # of time; see `comms`


AnyCommunicationModel = Annotated[NoCommunication | Broadcast, Field(discriminator="kind")]


class TaskSpec(Frozen):
    """One task, completely: physics, robots, obstacles, rewards, sensing and communication."""

    rules: Rules = NavigationRules()
    version: Annotated[int, Field(ge=0)] = 0
    team: Annotated[tuple[Role, ...], Field(min_length=1)] = (Role(),)
    arena: Arena = Arena()
    obstacles: Obstacles = Obstacles()
    spawn: Spawn = Spawn()
    horizon: Annotated[int, Field(ge=1)] = 160
    control_dt: Positive = 0.1
    physics_dt: Positive = 0.05
    on_collision: Literal["continue", "fail"] = "continue"
    observation: AnyObservationModel = StateModel()
    communication: AnyCommunicationModel = NoCommunication()

    @model_validator(mode="after")
    def _check_time_steps(self) -> Self:
        ratio = self.control_dt / self.physics_dt
        if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 2:
            raise ValueError(
                f"control_dt must be at least 2 whole multiples of physics_dt, got {ratio:g} "
                "(a force moves a body only from the next physics step on)"
            )
        return self

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.rules.task

    @property
    def action_size(self) -> int:
        """Length A of one robot's action: two for driving, then those of a learned message."""
        channel = self.communication
        is_learned = isinstance(channel, Broadcast) and channel.payload == "learned"
        return 2 + (channel.message_size if is_learned else 0)

    @property
    def n_agents(self) -> int:
        """Number of robots, N."""
        return sum(role.count for role in self.team)

    @property
    def n_substeps(self) -> int:
        """Physics steps in one control step."""
        return round(self.control_dt / self.physics_dt)

    @property
    def robots(self) -> tuple[Robot, ...]:
        """The robot of each agent, N long, in agent order."""
        return tuple(role.robot for role in self.team for _ in range(role.count))

    @property
    def agent_names(self) -> tuple[str, ...]:
        """Names such as `robot_0`, N long, in agent order."""
        return tuple(f"{role.name}_{i}" for role in self.team for i in range(role.count))

    def with_updates(self, **changes: Any) -> "TaskSpec":
        """Returns a validated copy with top-level fields replaced."""
        return type(self).parse({**self.model_dump(), **changes})


class PolicySource(Frozen):
    """One behaviour policy of a recipe, and its share of the joint steps."""

    label: str  # unique in the recipe, such as "expert-0"
    name: str  # registered policy
    checkpoint: str | None = None  # file in the package's `behavior_policies/checkpoints`
    sha256: str | None = None  # of that file
    noise: NonNegative = 0.0  # standard deviation of the Gaussian action noise
    share: Positive = 1.0  # relative share of the joint steps


class Splits(Frozen):
    """Episodes of each split in every block of `block` consecutive episodes of one policy."""

    block: Annotated[int, Field(ge=3)] = 20
    validation: Annotated[int, Field(ge=1)] = 1
    test: Annotated[int, Field(ge=1)] = 1


class Recipe(Frozen):
    """Everything needed to make a dataset again, bit for bit.

    Each policy has its own stream of episodes, cut into parts of `part_episodes` episodes; part k
    of a policy is a pure function of the recipe and k. The dataset takes, again and again, the next
    episode of the policy that lags most behind its share of the steps, until there are at least
    `n_steps` joint steps. So a recipe with fewer steps makes a prefix of the same dataset.
    """

    id: Annotated[str, Field(pattern=r"^[a-z0-9_]+(-[a-z0-9_]+)+-v[0-9]+$", max_length=96)]
    tier: str
    spec: TaskSpec
    policies: Annotated[tuple[PolicySource, ...], Field(min_length=1)]
    seed: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    n_steps: Annotated[int, Field(ge=1)] = 1_000_000
    part_episodes: Annotated[int, Field(ge=1)] = 256
    splits: Splits = Splits()

    @model_validator(mode="after")
    def _check_labels(self) -> Self:
        labels = [policy.label for policy in self.policies]
        if len(set(labels)) != len(labels):
            raise ValueError(f"policy labels must be unique, got {labels}")
        return self


class _UniqueKeyLoader(yaml.SafeLoader):
    """A safe YAML loader that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        twice = {key for key in keys if keys.count(key) > 1}
        if twice:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {min(twice)!r} is given twice", node.start_mark
            )
        return super().construct_mapping(node, deep)


def _explain(model: type[BaseModel], problem: Any) -> str:
    path = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, problem["loc"][:-1])
        hint = did_you_mean(str(problem["loc"][-1]), known)
        return f"{path}: unknown key.{hint} Known: {', '.join(known)}"
    got = f" (got {problem['input']!r})" if problem["type"] != "missing" and path else ""
    return f"{path or model.__name__}: {problem['msg']}{got}"


def _known_keys(model: type[BaseModel], loc: tuple[Any, ...]) -> list[str]:
    """Fields of the nested model at `loc`; tuple positions do not descend, tags choose."""
    options = [model]
    for part in loc:
        fields = [option.model_fields[part] for option in options if part in option.model_fields]
        if fields:
            options = list(_nested_models(fields[0].annotation)) or options
        else:
            options = [option for option in options if part in _tags(option)] or options
    return list(options[0].model_fields)


def _tags(model: type[BaseModel]) -> set[Any]:
    """Values of the model's literal fields, one of which tells it from others of its union."""
    return {field.default for field in model.model_fields.values()}


def _nested_models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _nested_models(inner)
