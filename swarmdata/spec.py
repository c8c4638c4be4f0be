"""TaskSpec, the whole problem as frozen data, and Recipe, all that makes a dataset again.

Two equal specs give the same world; two equal recipes give the same dataset.

Lengths are metres, times seconds, speeds metres per second, angles radians.
"""

import hashlib
import json
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


class Termination(Frozen):
    """When the task ends before the horizon."""

    goal_radius: Positive = 0.15
    at_goal: Literal["hold"] = "hold"  # robots at their goals stay controllable
    on_collision: Literal["continue", "fail"] = "continue"


class Rewards(Frozen):
    """Weight of each named reward term; terms a task does not have must stay 0."""

    progress: NonNegative = 2.0  # per metre that a robot comes closer to its goal
    success: NonNegative = 3.0  # once, to every robot, when all are at their goals
    time: NonNegative = 0.02  # per step outside the own goal
    robot_contact: NonNegative = 0.2  # per step in contact with a robot
    obstacle_contact: NonNegative = 0.2  # per step in contact with an obstacle or wall
    robot_collision: NonNegative = 0.5  # per contact with a robot that begins
    obstacle_collision: NonNegative = 0.5  # per contact with an obstacle or wall that begins
    proximity: NonNegative = 0.2  # per step, times how deep in the last 0.1 m before contact
    team_share: Probability = 0.0  # part of each reward that is the mean over the team


class ObservationModel(Frozen):
    """What a robot senses."""

    kind: Literal["state", "lidar", "bearing", "occupancy"] = "state"
    frame: Literal["world"] = "world"
    n_neighbors: Annotated[int, Field(ge=0)] = 3
    n_obstacles: Annotated[int, Field(ge=0)] = 3
    range: Positive = 1.0  # distance at which closeness features reach 0


class CommunicationModel(Frozen):
    """Who hears what, and when."""

    kind: Literal["none", "broadcast"] = "none"
    payload: Literal["pose", "pose_and_goal", "learned"] = "pose"
    topology: Literal["full", "nearest", "ring", "star", "range"] = "full"
    range: Positive | None = None
    drop_probability: Probability = 0.0
    delay: Annotated[int, Field(ge=0)] = 0  # control steps
    messages_per_step: Annotated[int, Field(ge=1)] | None = None
    bits: Annotated[int, Field(ge=1)] | None = None  # per message value


class TaskSpec(Frozen):
    """One task, completely: physics, robots, obstacles, rewards, sensing and communication."""

    task: str = "coop_nav"
    version: Annotated[int, Field(ge=0)] = 0
    team: Annotated[tuple[Role, ...], Field(min_length=1)] = (Role(),)
    arena: Arena = Arena()
    obstacles: Obstacles = Obstacles()
    spawn: Spawn = Spawn()
    horizon: Annotated[int, Field(ge=1)] = 160
    control_dt: Positive = 0.1
    physics_dt: Positive = 0.05
    rewards: Rewards = Rewards()
    termination: Termination = Termination()
    observation: ObservationModel = ObservationModel()
    communication: CommunicationModel = CommunicationModel()

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
    """Fields of the nested model at `loc`; integers (tuple positions) do not descend."""
    for part in loc:
        if isinstance(part, str) and part in model.model_fields:
            model = _nested_model(model.model_fields[part].annotation) or model
    return list(model.model_fields)


def _nested_model(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_nested_model(inner) for inner in getattr(annotation, "__args__", ()))
    return next((model for model in found if model), None)
