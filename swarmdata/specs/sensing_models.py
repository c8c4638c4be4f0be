"""Observation models and communication models as data."""

import math
import operator
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, model_validator

from swarmdata.specs.frozen import Frozen, NonNegative, Positive, Probability

Model = TypeVar("Model", bound=Frozen)


class SensorNoise(Frozen):
    """Standard deviations of the Gaussian noise on each kind of measurement, anew in each step.

    Every feature is computed of noisy measurements (`sensing.measured_world`).
    """

    position: NonNegative = 0.0  # m, of the own position and of displacements, each component
    velocity: NonNegative = 0.0  # m/s, of the own velocity and of relative ones, each component
    direction: NonNegative = 0.0  # rad, of the own heading, of axes and of bearings
    range: NonNegative = 0.0  # m, of beams and of distances measured by range and bearing


class Drift(Frozen):
    """How fast the pose drifts that a robot reckons from its odometry: see `sensing.odometry`.

    Each rate is the standard deviation of a bias, which an episode draws for each robot, and that
    of a random walk after one metre (or radian).
    """

    position: NonNegative = 0.0  # m per metre driven
    heading: NonNegative = 0.0  # rad per metre driven, of unicycles; other robots have a compass
    turning: NonNegative = 0.0  # rad per radian turned, of unicycles


class ObservationModel(Frozen):
    """The degradations that every observation model has, applied in this order.

    Noise is added to the measurements. Each object (a robot, an obstacle), beam or cell is missed
    with probability `dropout`. The whole observation, that of the robot itself included, is `delay`
    steps old. The last `stack` frames are concatenated, newest first; at the beginning of an
    episode the first frame is repeated. All of it is a function of the episode's seed and the
    step.

    With `goal_steps`, frames that are sensed after so many steps do not tell the robot's goal: all
    features of `Feature.tells_goal` are 0, those of the task among them, and named `shown_...`.
    Without `velocities`, robots have no estimates of any: frames have no features of that kind.

    With `drift`, robots know their pose at the beginning of an episode, and then reckon it from
    their odometry. What is relative to the body stays as it is measured. Places in the world's
    frame, such as the own goal, are where the robot believes them to be, and it sends the pose that
    it believes in. Within `landmarks` of a corner or the middle of the arena it knows its pose
    again.

    With `ways`, robots have a map of the obstacles: observations end with the direction and the
    length of the way around them to each place that they tell, and how many others are nearer. The
    places are the robot's target, those that the task adds, and targets in messages
    (`perception.wayfinder`).
    """

    later_fields: ClassVar[tuple[str, ...]] = (
        "goal_steps", "velocities", "ways", "drift", "landmarks",
    )  # fmt: skip

    noises: ClassVar[tuple[str, ...]] = ("position", "velocity", "direction")
    """Fields of `SensorNoise` that the model uses."""

    noise: SensorNoise = SensorNoise.defaults()  # of the measurements
    dropout: Probability = 0.0  # chance that an object, beam or cell is missed
    delay: Annotated[int, Field(ge=0, le=10**12)] = 0  # control steps
    stack: Annotated[int, Field(ge=1, le=10**12)] = 1  # frames
    goal_steps: Annotated[int, Field(ge=0, le=10**12)] | None = None  # None: always shown
    velocities: bool = True  # the own one, and those of others relative to it
    ways: bool = False  # around obstacles, to the places that are observed
    drift: Drift = Drift.defaults()  # of the own pose
    landmarks: Positive | None = None  # m, from which they tell the pose; None: there are none

    @property
    def in_body_frame(self) -> bool:
        """Whether vectors are in the robot's own frame, not in the world's."""
        return True


class StateModel(ObservationModel):
    """Low-dimensional state: self, nearest robots, nearest obstacles.

    In the body's frame there is no own position, and all vectors are turned by the own heading. A
    holonomic robot's heading is the world's x axis: its commands are vectors in the world's frame,
    which only a robot with a compass can follow.
    """

    later_fields: ClassVar[tuple[str, ...]] = (*ObservationModel.later_fields, "frame")

    kind: Literal["state"] = "state"
    n_neighbors: Annotated[int, Field(ge=0, le=10**12)] = 3  # slots of robots, the nearest first
    n_obstacles: Annotated[int, Field(ge=0, le=10**12)] = 3  # slots of obstacles, the nearest first
    range: Positive = 1.0  # m, gap at which closeness features reach 0
    limit: Positive | None = None  # m, gap beyond which nothing is seen; None: no limit
    frame: Literal["world", "body"] = "world"  # of positions and vectors

    @property
    def in_body_frame(self) -> bool:
        """Whether vectors are in the robot's own frame, not in the world's."""
        return self.frame == "body"


class LidarModel(ObservationModel):
    """A range scan with hit types in the body's frame, and the target in polar form."""

    noises: ClassVar[tuple[str, ...]] = (*ObservationModel.noises, "range")

    kind: Literal["lidar"] = "lidar"
    n_rays: Annotated[int, Field(ge=1, le=10**12)] = 16  # beams all around
    range: Positive = 2.0  # m from the robot's centre


class BearingModel(ObservationModel):
    """Bearings and ranges of visible neighbours in the body's frame, occluded ones missing."""

    noises: ClassVar[tuple[str, ...]] = (*ObservationModel.noises, "range")

    kind: Literal["bearing"] = "bearing"
    n_neighbors: Annotated[int, Field(ge=0, le=10**12)] = 3  # slots of robots, the nearest first
    range: Positive = 2.0  # m between centres


class OccupancyModel(ObservationModel):
    """A coarse egocentric grid in the body's frame: which cells hold what."""

    kind: Literal["occupancy"] = "occupancy"
    cells: Annotated[int, Field(ge=1, le=10**12)] = 9  # in each direction
    cell_size: Positive = 0.3  # m


AnyObservationModel = Annotated[
    StateModel | LidarModel | BearingModel | OccupancyModel, Field(discriminator="kind")
]


class NoCommunication(Frozen):
    """Robots do not communicate."""

    kind: Literal["none"] = "none"


class Bursts(Frozen):
    """A link's two states after Gilbert (1960) and Elliott (1963): good ones, and bad bursts."""

    enter: Probability = 0.05  # chance per step that a good link turns bad
    leave: Probability = 0.25  # chance per step that a bad link turns good
    drop_probability: Probability = 1.0  # while a link is bad


class Broadcast(Frozen):
    """Each robot broadcasts one message in every step; the channel decides who gets it, and when.

    The order is: quantise, pick the links by topology and range, spend the bandwidth, collide,
    drop, delay. A receiver keeps the newest message of each sender, until it is older than
    `max_age`.

    With payload `errand` each robot knows where the next one should go (the first is the next of
    the last), and sends that with its pose; only that robot reads it.
    """

    later_fields: ClassVar[tuple[str, ...]] = ("max_age",)

    kind: Literal["broadcast"] = "broadcast"
    payload: Literal["pose", "pose_and_goal", "errand", "state", "learned"] = "pose"
    """What a message holds."""
    message_size: Annotated[int, Field(ge=1, le=10**12)] = 4  # values of a learned message
    topology: Literal["full", "nearest", "ring", "star"] = "full"  # who is linked to whom
    n_nearest: Annotated[int, Field(ge=1, le=10**12)] = 2  # of topology "nearest"
    range: Positive | None = None  # m between centres; None: no limit
    drop_probability: Probability = 0.0  # of each message, independently
    bursts: Bursts | None = None  # losses in bursts; None: none
    delay: Annotated[int, Field(ge=0, le=10**12)] = 0  # control steps
    messages_per_step: Annotated[int, Field(ge=1, le=10**12)] | None = None  # a robot can receive
    bits: Annotated[int, Field(ge=1, le=24)] | None = None  # of each value of a message
    slots_in_step: Annotated[int, Field(ge=1, le=10**12)] | None = None  # of time; see `links`
    max_age: Annotated[int, Field(ge=0, le=253)] | None = None  # steps; None: kept for ever

    @model_validator(mode="after")
    def _arrives_before_it_is_forgotten(self) -> Self:
        if self.max_age is not None and self.max_age < self.delay:
            raise ValueError(
                f"max_age {self.max_age} forgets messages before they arrive, {self.delay} steps "
                f"after they were sent; expected at least delay {self.delay}"
            )
        return self


AnyCommunicationModel = Annotated[NoCommunication | Broadcast, Field(discriminator="kind")]


def modified(own: Frozen, named: Model, name: str) -> Model:
    """Returns a task's own model with what a name changes, the set fields of `named`.

    Noise, drift, misses, losses and delays add to those of the task, as those of independent causes
    do. Another kind of sensor keeps what all kinds have (`ObservationModel`).

    Raises:
        SpecError: the two do not go together.
    """
    is_same_kind = type(own) is type(named)
    kept = type(own).model_fields if is_same_kind else ObservationModel.model_fields
    fields: dict[str, Any] = {field: getattr(own, field) for field in kept}
    for field in named.model_fields_set:
        value = getattr(named, field)
        add = _ADDED.get(field)
        fields[field] = value if add is None else add(fields[field], value)
    return type(named).parse(fields, name)


def _either(first: float, second: float) -> float:
    """The probability that one of two independent events happens."""
    return first + second - first * second


def _joint(first: Model, second: Model) -> Model:
    """The deviations of the sum of two independent errors."""
    sums = {
        field: math.hypot(getattr(first, field), getattr(second, field))
        for field in type(first).model_fields
    }
    return type(first)(**sums)


_ADDED: dict[str, Callable[[Any, Any], Any]] = {
    "noise": _joint,
    "drift": _joint,
    "dropout": _either,
    "drop_probability": _either,
    "delay": operator.add,
}
"""How the fields add that do; each is the same without the first or the second."""
