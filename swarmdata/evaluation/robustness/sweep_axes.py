"""Axes of a robustness sweep: one parameter of what robots hear or see, and the values it takes.

An axis is written `drop=0..0.8`, some values evenly spread between two ends, or `drop=0,0.3,0.6`.
Its name is a field of the communication or observation model, such as `delay` or `noise.velocity`,
or one of the short names below. Fields that decide how many numbers a policy reads, or what one
unit of them is, are no axes: a policy would misread what it sees rather than see less.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import Any, Literal, get_args

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.features import Feature
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.model_choice import check_senses, describe
from swarmdata.specs.sensing_models import (
    BearingModel,
    Broadcast,
    LidarModel,
    ObservationModel,
    SensorNoise,
    StateModel,
)
from swarmdata.specs.task_spec import TaskSpec

Part = Literal["communication", "observation"]

Place = tuple[str | int, ...]
"""Keys from the top of a spec to one of its values."""

SHORT = {
    "drop": "drop_probability",
    "bandwidth": "messages_per_step",
    "slots": "slots_in_step",
}
"""Short names of fields of the communication model."""

NOISES = tuple(SensorNoise.model_fields)
"""What the short name `noise` sets, as `noise-0.05` does in the name of an observation model."""

UNITS = {"state": "range", "lidar": "range", "bearing": "range", "occupancy": "cell_size"}
"""The field of each kind of observation model that is the unit of what robots see."""

_HINT = (
    "What changes the number or the unit of the features cannot be swept: the policy would misread "
    "them."
)


@dataclass(frozen=True)
class Axis:
    """One parameter and its values, in the order in which they are shown."""

    part: Part
    name: str
    values: tuple[float, ...]  # whole numbers are integers where the field is

    @property
    def parameter(self) -> str:
        """Such as `communication drop`."""
        return f"{self.part} {self.name}"

    @property
    def falls(self) -> bool:
        """Whether the values fall from left to right."""
        return self.values[0] > self.values[-1]

    @property
    def option(self) -> str:
        """As it is written on the command line, every value named."""
        return f"--{self.part} {self.name}={','.join(map(str, self.values))}"


@dataclass(frozen=True)
class Course:
    """What an axis means for one policy."""

    trained: float | None  # the value it was trained with; None: unlimited, or not one number
    specs: tuple[TaskSpec, ...]  # one for each value of the axis


def parse_axis(text: str, part: Part, n_points: int = 5) -> Axis:
    """Reads an axis.

    Args:
        text: `name=a..b` for `n_points` values from a to b, both included, of whole numbers those
            that are different when rounded; or `name=a,b,...` for these. Either may fall as well
            as rise: the order is that of the figure.
        part: whose parameter it is.
        n_points: at least 2.

    Raises:
        SpecError: the text is malformed, or has fewer than two different values.
    """
    name, equals, given = (each.strip() for each in text.partition("="))
    if not (name and equals and given):
        raise _malformed(text, part, f"got {text!r}")
    if n_points < 2:
        raise SpecError(f"{n_points} points of {text!r}, expected at least 2.")
    low, dots, high = given.partition("..")
    if dots:
        first, last = _number(low, text, part), _number(high, text, part)
        exact = [first + (last - first) * k / (n_points - 1) for k in range(n_points)]
        if _is_whole(part, name):
            exact = [Fraction(round(value)) for value in exact]
        exact = list(dict.fromkeys(exact))
    else:
        exact = [_number(each, text, part) for each in given.split(",")]
    whole = _is_whole(part, name)
    values = [int(x) if whole and x.denominator == 1 else float(x) for x in exact]
    if len(set(values)) < max(2, len(values)):
        raise _malformed(text, part, f"its values are {values}, expected two or more different")
    return Axis(part, name, tuple(values))


def _number(text: str, axis: str, part: Part) -> Fraction:
    """Exact, so that the points between two ends are the nearest floats to what is meant."""
    try:
        value = Decimal(text.strip())
    except InvalidOperation:
        value = Decimal("nan")
    if not value.is_finite():
        raise _malformed(axis, part, f"{text.strip()!r} is not a number")
    return Fraction(value)


def _malformed(text: str, part: Part, problem: str) -> SpecError:
    return SpecError(
        f"--{part} {text}: {problem}. Write NAME=FROM..TO or NAME=A,B,..., such as "
        f"{'drop=0..0.8' if part == 'communication' else 'noise=0..0.2'}."
    )


def course_of(axis: Axis, policy: str, spec: TaskSpec) -> Course:
    """Returns the specs along an axis, each the policy's own but for one parameter.

    Args:
        axis: what is swept.
        policy: its name, for messages.
        spec: that it was trained on.

    Raises:
        UnknownNameError: the models of the spec have no such parameter.
        SpecError: a value out of its range, or communication of a policy that hears nothing.
        SchemaError: the policy could not read what a value gives.
    """
    if axis.part == "communication" and not isinstance(spec.communication, Broadcast):
        raise SpecError(
            f"{axis.option}: {policy} was trained without messages ({describe(spec)}), so no "
            "communication can hurt it. Sweep --observation, or train with messages: "
            "swarmdata train ... --communication perfect."
        )
    known = parameters(spec, axis.part)
    if axis.name not in known:
        kind = getattr(spec, axis.part).kind
        raise UnknownNameError(f"{axis.part} ({kind}) parameter", axis.name, known, _HINT)
    places = known[axis.name]
    specs = tuple(changed(spec, places, value, axis.option) for value in axis.values)
    features = features_of(make_task(spec))
    for offered in specs:
        check_senses(policy, spec, offered, features, features_of(make_task(offered)))
    trained = _value(spec, places)
    if axis.part == "observation" and axis.name == "range":
        trained = _checked_sight(axis, spec, trained)
    return Course(trained, specs)


def _checked_sight(axis: Axis, spec: TaskSpec, trained: float | None) -> float | None:
    """How far the robots see; a sensor that is said to see farther than its model does not."""
    model = spec.observation
    if not isinstance(model, LidarModel | BearingModel):
        return trained
    if max(axis.values) > model.range:
        raise SpecError(
            f"{axis.option}: got {max(axis.values):g} m, but the {model.kind} of this policy sees "
            f"{model.range:g} m. Farther changes nothing: take values up to {model.range:g}."
        )
    limits = [robot.sensor_range or model.range for robot in spec.robots]
    return min(limits[0], model.range) if len(set(limits)) == 1 else None


def parameters(spec: TaskSpec, part: Part) -> dict[str, tuple[Place, ...]]:
    """What can be swept of a spec: names, and the places that each of them sets.

    Fields come from the models themselves. `range` of what robots see is the limit of the `state`
    model, and of the others the range of the robots' own sensors, which leaves the unit as it is.
    """
    model = getattr(spec, part)
    features = features_of(make_task(spec))
    found: dict[str, tuple[Place, ...]] = {}
    for path, is_whole in _fields(type(model)):
        name, place = ".".join(path), (part, *path)
        is_unit = part == "observation" and name == UNITS[model.kind]
        if is_unit or _is_idle(model, path):
            continue
        if not (is_whole and _changes_features(spec, place, features)):
            found[name] = (place,)
    short = {name: (field,) for name, field in SHORT.items()}
    found |= {name: found[path[0]] for name, path in short.items() if path[0] in found}
    if part == "observation":
        found["noise"] = tuple((part, "noise", each) for each in NOISES)
        sensors = tuple(("team", k, "robot", "sensor_range") for k in range(len(spec.team)))
        found["range"] = found["limit"] if isinstance(model, StateModel) else sensors
    return found


def changed(spec: TaskSpec, places: tuple[Place, ...], value: float, source: str) -> TaskSpec:
    """The spec with a value in each of these places; a model that is absent gets its defaults.

    Raises:
        SpecError: the value is out of range; `source` is named.
    """
    data = spec.model_dump(mode="json")
    for *path, last in places:
        node: Any = data
        for key in path:
            if node[key] is None:
                node[key] = {}
            node = node[key]
        node[last] = value
    return TaskSpec.parse(data, source)


def _value(spec: TaskSpec, places: tuple[Place, ...]) -> float | None:
    """The one number in all these places, None if there is none."""
    found = set()
    for place in places:
        node: Any = spec.model_dump(mode="json")
        for key in place:
            node = None if node is None else node[key]
        found.add(node)
    return found.pop() if len(found) == 1 else None


def _fields(model: type[Frozen]) -> Iterator[tuple[tuple[str, ...], bool]]:
    """Paths of the numbers in a model, and whether each is whole."""
    for name, field in model.model_fields.items():
        kinds = set(_types(field.annotation))
        if kinds & {int, float}:
            yield (name,), float not in kinds
        for kind in kinds:
            if issubclass(kind, Frozen):
                yield from (((name, *path), is_whole) for path, is_whole in _fields(kind))


def _types(annotation: Any) -> Iterator[type]:
    """The classes in an annotation, whatever is around them."""
    if isinstance(annotation, type):
        yield annotation
    for inner in get_args(annotation):
        yield from _types(inner)


def _is_whole(part: Part, name: str) -> bool:
    """Whether the models of a part have whole numbers by this name."""
    path = tuple(SHORT.get(name, name).split("."))
    models = _types(TaskSpec.model_fields[part].annotation)
    return any(dict(_fields(model)).get(path, False) for model in models)


def _is_idle(model: Frozen, path: tuple[str, ...]) -> bool:
    """Whether a field does nothing in this model."""
    if isinstance(model, Broadcast):
        needed: Mapping[str, bool] = {
            "n_nearest": model.topology == "nearest",
            "message_size": model.payload == "learned",
        }
        return not needed.get(path[0], True)
    if isinstance(model, ObservationModel):
        return path[0] == "noise" and path[1] not in model.noises
    return False


def _changes_features(spec: TaskSpec, place: Place, features: tuple[Feature, ...]) -> bool:
    """Whether one more of a whole number, or one less, changes what is observed or done."""
    now = _value(spec, (place,)) or 0
    for value in (now + 1, now - 1):
        try:
            other = changed(spec, (place,), value, "a probe")
            names = [feature.name for feature in features_of(make_task(other))]
        except SpecError:  # out of its range: the other one will do
            continue
        before = [feature.name for feature in features]
        return (names, other.action_size) != (before, spec.action_size)
    return False
