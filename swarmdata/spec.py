"""TaskSpec, the whole problem as frozen data, and Recipe, all that makes a dataset again.

Two equal specs give the same world; two equal recipes give the same dataset.

Lengths are metres, times seconds, speeds metres per second, angles radians.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from swarmdata.frozen import Frozen, NonNegative, Positive, Span
from swarmdata.rules import NavigationRules, Rules
from swarmdata.senses import (
    AnyCommunicationModel,
    AnyObservationModel,
    Broadcast,
    NoCommunication,
    StateModel,
)


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
        if isinstance(channel, Broadcast) and channel.payload == "learned":
            return 2 + channel.message_size
        return 2

    @property
    def n_agents(self) -> int:
        """Number of robots, N."""
        return sum(role.count for role in self.team)

    @property
    def half_size(self) -> tuple[float, float]:
        """Half width and half height of the arena, m: the largest |x| and |y| of its inside."""
        return self.arena.width / 2, self.arena.height / 2

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
