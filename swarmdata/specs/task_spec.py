"""TaskSpec, a whole problem as frozen data, in SI units: equal specs give equal worlds."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from swarmdata.errors import SpecError, SwarmdataError, UnknownNameError
from swarmdata.runtime.own_components import import_component
from swarmdata.specs import WORLD_VERSION
from swarmdata.specs.budget import excesses
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.frozen import Frozen, is_file, is_inline
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.plain_names import Name, repeated
from swarmdata.specs.quantities import (
    Acceleration,
    Count,
    CountOrNone,
    Delay,
    Distance,
    Duration,
    Friction,
    Lag,
    Length,
    Mass,
    Span,
    Speed,
    TurnRate,
)
from swarmdata.specs.randomization import PAYLOAD_RANGES, SENSED_RANGES, Randomization
from swarmdata.specs.rules import Rules, Side, TaskRules, rules_model
from swarmdata.specs.sensing_models import (
    AnyCommunicationModel,
    AnyObservationModel,
    Broadcast,
    Drift,
    NoCommunication,
    StateModel,
)
from swarmdata.specs.spaces import BoxSpace, Space

Backend = Literal["pymunk", "kinematic", "mujoco"]
"""What simulates a world: see `swarmdata.envs.physics`."""

BACKENDS: tuple[Backend, ...] = get_args(Backend)

OneTask = TypeVar("OneTask", bound=TaskRules)

ROW_SHAPES = "swarmdata.store.arrays.row_shapes:task_row_shapes"  # from a task's code


def _simulated(version: int) -> int:
    if version != WORLD_VERSION:
        raise ValueError(
            f"world version {version} is of another swarmdata, this one has the worlds of version "
            f"{WORLD_VERSION}; for newer worlds: pip install --upgrade swarmdata"
        )
    return version


def _named(find: Callable[[str], Frozen]) -> BeforeValidator:
    """Takes a name in the place of a model's fields, and no file: a spec is self-contained."""

    def model_of(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if is_file(value) or is_inline(value):
            raise ValueError(
                "expected a name such as lidar-32+noise-0.05 or lossy-30, or the model's fields"
            )
        try:
            return find(value)
        except SwarmdataError as error:
            raise ValueError(str(error)) from error

    return BeforeValidator(model_of)


SURFACE_FRICTION = 0.2  # of walls, obstacles and payloads, and of robots that have no other


class Robot(Frozen):
    """One kind of circular robot; its motors accelerate 1 kg by `max_acceleration`."""

    later_fields: ClassVar[tuple[str, ...]] = (
        "command_delay", "actuator_lag", "mass", "friction", "wheel_grip", "base", "drive",
    )  # fmt: skip

    radius: Length = 0.12  # m
    dynamics: Literal["holonomic", "unicycle"] = "holonomic"  # a unicycle cannot move sideways
    command: Literal["velocity", "acceleration"] = "velocity"  # what actions are, times the maximum
    max_speed: Speed = 0.6  # m/s
    max_acceleration: Acceleration = 1.5  # m/s^2, at a mass of 1 kg
    max_turn_rate: TurnRate = 3.0  # rad/s, unicycle only
    sensor_range: Length | None = None  # m, of this robot's sensors, if shorter than the model's
    command_delay: Delay = 0  # control steps until a command reaches the motors
    actuator_lag: Lag = 0.0  # s, time constant with which the motors follow it
    mass: Mass = 1.0  # kg
    friction: Friction = SURFACE_FRICTION  # of its hull; engines multiply those of two bodies
    wheel_grip: Acceleration = 10.0  # m/s^2 up to which wheels do not slip, unicycle only
    base: Literal["planar", "wheels"] = "planar"  # wheels: two and a caster, in MuJoCo, unicycle
    drive: Literal["independent", "differential"] = "independent"  # see `command_norm`

    @model_validator(mode="after")
    def _check_wheels(self) -> Self:
        usual = Robot.model_fields["wheel_grip"].default
        if self.dynamics == "holonomic" and self.wheel_grip != usual:
            raise ValueError(
                f"wheel_grip is {self.wheel_grip:g} m/s^2, but a holonomic robot has no wheels "
                "that slip. Leave it out, or use dynamics unicycle"
            )
        if self.dynamics == "holonomic" and self.base == "wheels":
            raise ValueError(
                "base wheels is two driven wheels and a caster, which cannot move in any direction "
                "as dynamics holonomic does. Use dynamics unicycle"
            )
        moves = self.dynamics, self.command
        if self.drive == "differential" and moves != ("unicycle", "velocity"):
            raise ValueError(
                "drive differential limits the speeds of two wheels, got dynamics "
                f"{self.dynamics} and command {self.command}. Use unicycle and velocity"
            )
        return self

    @property
    def command_norm(self) -> int | None:
        """The p-norm of a command in units of its limits that is at most 1; None: each number.

        A longer command is scaled down to norm 1. Holonomic: p = 2, the length of a vector. With
        drive differential p = 1: a wheel at a distance of L / 2 from the centre has the speed
        v +- w L / 2, and `max_turn_rate` is that of a turn in place, 2 `max_speed` / L.
        """
        if self.dynamics == "holonomic":
            return 2
        return 1 if self.drive == "differential" else None

    @property
    def acceleration(self) -> float:
        """The largest acceleration by commands, m/s^2: what motors give and wheels hold."""
        driven = self.max_acceleration / self.mass
        return min(driven, self.wheel_grip) if self.dynamics == "unicycle" else driven


class Role(Frozen):
    """`count` robots of one kind."""

    name: Name = "robot"  # unique in the team, whatever the case of its letters
    count: Count = 4  # robots of this kind
    robot: Robot = Robot.defaults()  # what they are


class Arena(Frozen):
    """A rectangle centred on the origin, inside thick walls."""

    width: Length = 4.0  # m, along x
    height: Length = 4.0  # m, along y
    wall_thickness: Length = 0.3  # m


class Obstacles(Frozen):
    """Numbers and sizes of the obstacles of each shape.

    A corner is an L of two bars, a pocket a U of three. Bounding circles stay `gap` apart from each
    other and from the walls, so that every passage is passable and every layout solvable.
    """

    circles: CountOrNone = 2  # number
    boxes: CountOrNone = 1  # number
    corners: CountOrNone = 1  # number
    pockets: CountOrNone = 2  # number
    circle_radius: Span = (0.12, 0.25)  # m, drawn from this range
    box_half_length: Span = (0.12, 0.25)  # m, of each side, likewise
    corner_half_length: Span = (0.25, 0.4)  # m, of the bars, likewise
    pocket_half_length: Span = (0.3, 0.4)  # m, of the bars, likewise
    bar_half_thickness: Length = 0.05  # m, of the bars of corners and pockets
    gap: Length = 0.34  # m between bounding circles, and to walls

    @property
    def number(self) -> int:
        """How many there are of all shapes."""
        return self.circles + self.boxes + self.corners + self.pockets


class Spawn(Frozen):
    """Where robots start and where their goals are: distances between surfaces."""

    start_clearance: Distance = 0.06  # m, of a start to obstacles and walls
    start_separation: Distance = 0.15  # m between starts
    goal_clearance: Distance = 0.15  # m, of a goal to obstacles and walls
    goal_separation: Distance = 0.25  # m between goals
    min_goal_distance: Distance = 1.2  # m from a start to its goal
    max_attempts: Count = 2000  # of drawing a layout before a SpawnError


class TaskSpec(Frozen):
    """One task, completely: physics, robots, obstacles, rewards, sensing and communication.

    `version` is that of the world: physics, rewards and tiers of one version never change, and a
    change of any of them makes the next version, with new ids. Only `WORLD_VERSION` is known here.
    """

    later_fields: ClassVar[tuple[str, ...]] = ("backend", "randomization")
    kind: ClassVar[str] = "task"  # in no JSON: tasks are older than other specs
    library: ClassVar[str] = "swarmdata"
    action_kind: ClassVar[Literal["unit"]] = "unit"
    state_meaning: ClassVar[str] = "The robots, the targets and the task's own columns."
    facts: ClassVar[tuple[()]] = ()
    limits: ClassVar[tuple[()]] = ()

    rules: Rules = Field(default_factory=lambda: rules_model("coop_nav").parse({}))
    """The kind of task, its goals and rewards; by default those of `coop_nav`."""
    version: Annotated[CountOrNone, AfterValidator(_simulated)] = WORLD_VERSION  # of the worlds
    team: Annotated[tuple[Role, ...], Field(min_length=1, max_length=64)] = (Role.defaults(),)
    """The robots, role by role."""
    arena: Arena = Arena.defaults()  # size of the arena
    obstacles: Obstacles = Obstacles.defaults()  # numbers and sizes of obstacles
    spawn: Spawn = Spawn.defaults()  # distances at the start
    horizon: Count = 160  # control steps of an episode, at most
    control_dt: Duration = 0.1  # s, between two commands
    physics_dt: Duration = 0.05  # s, of a physics step
    backend: Backend = "pymunk"  # what simulates it; kinematic: everything passes through all else
    on_collision: Literal["continue", "fail"] = "continue"  # fail: a collision ends the episode
    observation: Annotated[AnyObservationModel, _named(observation_model)] = StateModel.defaults()
    """What robots sense."""
    communication: Annotated[AnyCommunicationModel, _named(communication_model)] = (
        NoCommunication.defaults()
    )
    """What robots hear."""
    randomization: Randomization = Randomization.defaults()  # what each episode draws anew

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        """Raises with every contradiction between fields that are valid one by one."""
        problems = list(excesses(self))
        ratio = self.control_dt / self.physics_dt
        if abs(ratio - round(ratio)) > 1e-9 or round(ratio) < 2:
            problems.append(
                f"control_dt must be at least 2 whole multiples of physics_dt, got {ratio:g} "
                "(a force moves a body only from the next physics step on)"
            )
        shows_goal = self.observation.goal_steps is None
        if not shows_goal and getattr(self.communication, "payload", "") == "pose_and_goal":
            problems.append(
                "communication.payload pose_and_goal sends the goal that observation.goal_steps "
                "hides from the sender. Let others know it, with payload errand, or leave "
                "goal_steps out"
            )
        if self.observation.landmarks is not None and self.observation.drift == Drift():
            problems.append(
                "observation.landmarks correct the drift of poses, but observation.drift is 0. "
                "Set it, for example with drift-0.02, or leave landmarks out"
            )
        problems += _unsimulated(self)
        if self.on_collision == "fail" and len(self.rules.side_names) > 1:
            problems.append(
                f"on_collision fail ends an episode in which no side of {self.task} has won. Use "
                "on_collision continue"
            )
        if twice := repeated(role.name.casefold() for role in self.team):
            problems.append(
                f"team has several roles named {', '.join(twice)}, expected a `name` of its own "
                "for each role: robots are called by it and a number"
            )
        if problems:
            raise ValueError("; ".join(problems))
        return self

    @property
    def world(self) -> "TaskSpec":
        """Itself."""
        return self

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.rules.task

    def rules_as(self, model: type[OneTask]) -> OneTask:
        """Its rules, known to be of one task.

        Raises:
            SpecError: they are of another task.
        """
        if not isinstance(self.rules, model):
            wanted = model.model_fields["task"].default
            raise SpecError(f"rules.task is {self.task!r}, expected {wanted!r}")
        return self.rules

    @property
    def time_step(self) -> float:
        """Duration of a joint step, s."""
        return self.control_dt

    @property
    def action_size(self) -> int:
        """Length A of one robot's action: two for driving, then those of a learned message."""
        channel = self.communication
        if isinstance(channel, Broadcast) and channel.payload == "learned":
            return 2 + channel.message_size
        return 2

    @property
    def observation_size(self) -> int:
        """Columns of a robot's observation, O, which the task's code has."""
        return self._width("observations")

    @property
    def state_size(self) -> int:
        """Columns of a state, S, which the task's code has."""
        return self._width("states")

    def _width(self, array: str) -> int:
        return int(import_component(ROW_SHAPES)(self, widths=True)[array][-1])

    @property
    def action_spaces(self) -> tuple[Space, ...]:
        """Commands in [-1, 1] of each robot, N long."""
        space = BoxSpace(shape=(self.action_size,), dtype="float32", low=-1.0, high=1.0)
        return (space,) * self.n_agents

    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        """Unbounded numbers, `n_columns` of each robot, N long."""
        return (BoxSpace(shape=(n_columns,), dtype="float32"),) * self.n_agents

    @property
    def n_agents(self) -> int:
        """Number of robots, N."""
        return sum(role.count for role in self.team)

    @property
    def sides(self) -> tuple[Side, ...]:
        """The sides of the task, in agent order; one side with all robots in most tasks."""
        return self.rules.sides(self)

    def side(self, name: str) -> Side:
        """The side of this name.

        Raises:
            UnknownNameError: the task has no such side.
            SpecError: the task has one side only.
        """
        sides = {side.name: side for side in self.sides}
        if len(sides) == 1:
            raise SpecError(f"{self.task} has one side, got side {name!r}. Leave it out")
        if name not in sides:
            raise UnknownNameError("side", name, sides)
        return sides[name]

    @property
    def side_bounds(self) -> tuple[int, ...]:
        """The first agent of each side, and after the last side N."""
        return (*(side.agents.start for side in self.sides), self.n_agents)

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

    def largest(self, name: str) -> tuple[float, ...]:
        """The largest value of a robot's field in any episode, N long, in agent order."""
        drawn = self.randomization.ranges.get(name)
        return tuple(getattr(each, name) if drawn is None else drawn[1] for each in self.robots)

    @property
    def agent_names(self) -> tuple[str, ...]:
        """Names such as `robot_0`, N long, in agent order."""
        return tuple(f"{role.name}_{i}" for role in self.team for i in range(role.count))

    def with_updates(self, **changes: Any) -> "TaskSpec":
        """Returns a validated copy with top-level fields replaced.

        What a mapping leaves out has its default; names of models, such as `lossy-30`, modify the
        spec's own, as everywhere. Noise or losses that a model changes are no longer drawn, unless
        `randomization` is given.
        """
        readers: dict[str, Callable[..., Any]] = {
            "observation": observation_model, "communication": communication_model,
        }  # fmt: skip
        named = {
            name: read(changes[name], getattr(self, name))
            for name, read in readers.items()
            if isinstance(changes.get(name), str)
        }
        data = {**self.model_dump(), **changes, **named}
        if self.randomization.ranges and "randomization" not in changes:
            found = type(self).parse({**data, "randomization": {}})
            data["randomization"] = {
                name: span
                for name, span in self.randomization.ranges.items()
                if _value_beside(found, name) == _value_beside(self, name)
            }
        return type(self).parse(data)


def _value_beside(spec: TaskSpec, name: str) -> Any:
    """What a model of a spec has instead of a range of this name; None if no model has any."""
    return getattr(getattr(spec, SENSED_RANGES.get(name, ""), None), name, None)


def _unsimulated(spec: TaskSpec) -> Iterator[str]:
    """Yields what the robots or ranges of a spec have, and its simulator or its parts have not."""
    robots, drawn = [role.robot for role in spec.team], spec.randomization.ranges
    is_rough = any(robot.friction != SURFACE_FRICTION for robot in robots) or "friction" in drawn
    if spec.backend == "kinematic" and is_rough:
        yield (
            "robots have a friction, but backend kinematic has no contacts. Leave friction out, or "
            "use backend pymunk or mujoco"
        )
    if spec.backend != "mujoco" and any(robot.base == "wheels" for robot in robots):
        yield (
            f"base wheels needs backend mujoco, got {spec.backend}, which has no floor. Use "
            "backend mujoco, or base planar"
        )
    if all(robot.dynamics == "holonomic" for robot in robots):
        for name in ("max_turn_rate", "wheel_grip"):
            if name in drawn:
                yield f"randomization.{name} is of unicycles, but no robot is one. Leave it out"
    for name in PAYLOAD_RANGES.keys() & drawn.keys():
        if spec.rules.payload_field is None:
            yield f"randomization.{name} needs a payload, got task {spec.task}. Leave it out"
        elif spec.backend == "kinematic":
            yield (
                f"randomization.{name} has no effect in backend kinematic, whose payloads stay "
                "where they are. Leave it out, or use backend pymunk or mujoco"
            )
    if "drop_probability" in drawn and not isinstance(spec.communication, Broadcast):
        yield (
            "randomization.drop_probability needs messages, got communication none. Leave it out, "
            "or choose a communication such as perfect"
        )
