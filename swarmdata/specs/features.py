"""Features, the numbers of an observation: name, physical kind, and axis if part of a vector."""

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

Kind = Literal["position", "velocity", "direction", "range", "flag"]
"""m, m/s, component of a vector of at most unit length, normalised distance, 0 or 1 or a code."""

UNITS: dict[Kind, str] = {"position": "m", "velocity": "m/s"}  # the other kinds have none


class Feature(NamedTuple):
    """One number of one robot's observation."""

    name: str
    kind: Kind
    axis: Literal["", "x", "y"] = ""  # a y always follows its x
    meaning: str = ""  # for cards
    tells_goal: bool = False  # where the robot should go; see `ObservationModel.goal_steps`
    is_place: bool = False  # of a vector that leads there; see `ObservationModel.ways`

    @property
    def slot(self) -> str:
        """The slot it is part of, by its name: `neighbor_0`, in older frames `neighbor_0[-1]`."""
        owner, _, part = self.name.rpartition(".")
        return owner + part[len(part.partition("[")[0]) :]

    @property
    def is_mask(self) -> bool:
        """Whether this is the mask of its slot: 1 if the slot holds something."""
        return self.name.rpartition(".")[2].partition("[")[0] == "mask"


def vector(name: str, kind: Kind, meaning: str = "") -> tuple[Feature, Feature]:
    """The two components of a planar vector, named `<name>_x` and `<name>_y`."""
    return Feature(f"{name}_x", kind, "x", meaning), Feature(f"{name}_y", kind, "y", meaning)


def telling_goals(features: Iterable[Feature]) -> tuple[Feature, ...]:
    """The same features, marked as those that tell a robot's goal."""
    return tuple(feature._replace(tells_goal=True) for feature in features)


def leading_to_places(features: Iterable[Feature]) -> tuple[Feature, ...]:
    """The same vectors, marked as places relative to the robot, to which it may drive."""
    return tuple(feature._replace(is_place=True) for feature in features)


def shown_for(n_steps: int, feature: Feature) -> Feature:
    """The feature, renamed `shown_...` if it tells the goal, which is hidden after some steps."""
    if not feature.tells_goal:
        return feature
    slot, dot, name = feature.name.rpartition(".")
    meaning = f"{feature.meaning}; 0 from step {n_steps} on"
    return feature._replace(name=f"{slot}{dot}shown_{name}", meaning=meaning)


def stacked(frame: Sequence[Feature], n_frames: int) -> tuple[Feature, ...]:
    """The features of a frame and of those before it, newest first; older ones say their age."""
    ages = range(1, n_frames)
    return (*frame, *(f._replace(name=f"{f.name}[-{age}]") for age in ages for f in frame))


def numbered(prefix: str, n: int, fields: Iterable[Feature]) -> tuple[Feature, ...]:
    """`n` slots of the same fields, named `<prefix>_<k>.<field>`."""
    fields = tuple(fields)
    return tuple(
        field._replace(name=f"{prefix}_{k}.{field.name}") for k in range(n) for field in fields
    )
