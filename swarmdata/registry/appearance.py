"""Appearance, what a task looks like in pictures, as its method `appearance(spec)` says."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from swarmdata.specs.rules import Payload


class SharedTargets(NamedTuple):
    """Targets that belong to no robot: their positions are the first of the task's extras."""

    n: int  # x and y of each, one after the other
    reached: int | None = None  # the extra that is positive once the first is reached, and so on
    """None: a target is reached while a robot is on it."""
    known: int | None = None  # the extra that is positive once robot 0 knows the first target
    """Then of the others; then of the next robots. None: robots know all from the start."""


class Moment(NamedTuple):
    """A step in which a term of the reward is positive, as an event of a robot."""

    term: str
    one: str  # what one robot does, such as "picks up"
    several: str  # what several do, such as "pick up"


@dataclass(frozen=True)
class Appearance:
    """How the targets of a task are drawn, and what its legend says; the default suits any task."""

    legend: str = "Rings are the targets of the robots, each in the color of its robot."
    """What the marks of targets mean, whole sentences."""
    mark: Literal["ring", "slot", "pose"] = "ring"
    """Of a target; a pose is the outline of the first movable body at robot 0's target."""
    radius: float | None = None
    """Distance, m, within which a target is reached; None: the radius of its robot."""
    shared: SharedTargets | None = None
    """Targets of no robot, which are drawn in the place of the robots' own."""
    is_linked: bool = False  # whether dashes lead from each robot to its own target
    nowhere: tuple[float, float] | None = None  # where the target of a robot is that has none
    direction: int | None = None
    """The extra with the first component of a pose's direction; None: any will do."""
    carrying: tuple[int, ...] = ()
    """The extra of each robot that is positive while it carries something, if any."""
    bodies: tuple[Payload, ...] = ()  # that robots can push, as the task's `movables`
    moments: tuple[Moment, ...] = ()  # events beside contacts; at most `MOST_MOMENTS`


MOST_MOMENTS = 7  # kinds of moments that fit into an event's code in the data files of a catalogue
