"""Axes of a robustness sweep: a parameter of a model or of the robots' bodies, and its values.

Its name is a field of the communication or observation model, such as `noise.velocity`, or one of
the short names below. Fields that change the number or the unit of the features cannot be axes: a
policy would misread its observations rather than observe less.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import Any, Literal

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.features import Feature
from swarmdata.specs.frozen import Frozen, classes_in
from swarmdata.specs.model_choice import check_senses, describe
from swarmdata.specs.randomization import PAYLOAD_RANGES
from swarmdata.specs.sensing_models import (
    BearingModel,
    Broadcast,
    Drift,
    LidarModel,
    ObservationModel,
    SensorNoise,
    StateModel,
)
from swarmdata.specs.task_spec import Robot, TaskSpec

Part = Literal["communication", "observation", "body"]

Place = tuple[str | int, ...]  # keys from the top of a spec to one of its values

SHORT_NAMES = {
    "drop": "drop_probability",
    "bandwidth": "messages_per_step",
    "slots": "slots_in_step",
}
"""Short names of fields of the communication model."""

BODY_FIELDS = (
    "max_speed", "max_acceleration", "max_turn_rate", "command_delay", "actuator_lag", "mass",
    "friction", "wheel_grip",
)  # fmt: skip
"""Fields of `task_spec.Robot` that are axes of the body."""

UNICYCLE_FIELDS = ("max_turn_rate", "wheel_grip")  # those of them that only unicycles have

EXAMPLES: Mapping[Part, str] = {
    "communication": "drop=0..0.8",
    "observation": "noise=0..0.2",
    "body": "max_acceleration=1.5..0.5",
}
"""How to write an axis, by its part."""

JOINT_NAMES: Mapping[str, type[Frozen]] = {"noise": SensorNoise, "drift": Drift}
"""Short names that set all fields of a part, as in the model names `noise-0.05`, `drift-0.02`."""

UNIT_FIELDS = {"state": "range", "lidar": "range", "bearing": "range", "occupancy": "cell_size"}
"""The field of each kind of observation model that is the unit of its features."""

_FIXED_FIELDS_HINT = (
    "Parameters that change the number or the unit of the features cannot be swept: the policy "
    "would misread them."
)


@dataclass(frozen=True)
class Axis:
    """A parameter and its values, in the order of the figure."""

    part: Part
    name: str
    values: tuple[float, ...]  # integers if the field is an integer

    @property
    def parameter(self) -> str:
        """The name with its part, such as `communication drop`."""
        return f"{self.part} {self.name}"

    @property
    def falls(self) -> bool:
        """Whether the values decrease from left to right."""
        return self.values[0] > self.values[-1]

    @property
    def option(self) -> str:
        """The option of the command line, with all values."""
        return f"--{self.part} {self.name}={','.join(map(str, self.values))}"


@dataclass(frozen=True)
class AxisSpecs:
    """The specs along an axis for one policy."""

    trained: float | None  # value of its training; None: unlimited, or not a single number
    specs: tuple[TaskSpec, ...]  # one for each value of the axis


def parse_axis(text: str, part: Part, n_points: int = 5) -> Axis:
    """Parses an axis of a model: `name=a..b`, `n_points` values with both ends, or `name=a,b,...`.

    Between two ends, values of integer fields are rounded, without duplicates. Values may decrease;
    the figure has their order.
    """
    name, equals, given = (each.strip() for each in text.partition("="))
    if not (name and equals and given):
        raise _malformed(text, part, f"got {text!r}")
    if n_points < 2:
        raise SpecError(f"{n_points} points of {text!r}, expected at least 2.")
    low, dots, high = given.partition("..")
    whole = _is_whole(part, name)
    if dots:
        first, last = _number(low, text, part), _number(high, text, part)
        exact = [first + (last - first) * k / (n_points - 1) for k in range(n_points)]
        exact = list(dict.fromkeys(Fraction(round(x)) if whole else x for x in exact))
    else:
        exact = [_number(each, text, part) for each in given.split(",")]
    values = [int(x) if whole and x.denominator == 1 else float(x) for x in exact]
    if len(set(values)) < max(2, len(values)):
        raise _malformed(text, part, f"its values are {values}, expected two or more different")
    return Axis(part, name, tuple(values))


def _number(text: str, axis: str, part: Part) -> Fraction:
    """Parses a number exactly, so that points between two ends are the nearest floats."""
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
        f"{EXAMPLES[part]}."
    )


def specs_along_axis(axis: Axis, policy: str, spec: TaskSpec) -> AxisSpecs:
    """Returns the specs along an axis: that of a policy's training with another parameter.

    Raises:
        SchemaError: the policy cannot read the observations that a value gives.
    """
    if axis.part == "communication" and not isinstance(spec.communication, Broadcast):
        raise SpecError(
            f"{axis.option}: {policy} was trained without messages ({describe(spec)}), so "
            "worse communication does not affect it. Sweep --observation, or train with messages: "
            "swarmdata train ... --communication perfect."
        )
    known = parameters(spec, axis.part)
    if axis.name not in known:
        kind = spec.task if axis.part == "body" else getattr(spec, axis.part).kind
        hint = "" if axis.part == "body" else _FIXED_FIELDS_HINT
        raise UnknownNameError(f"{axis.part} ({kind}) parameter", axis.name, known, hint)
    places = known[axis.name]
    specs = tuple(changed(spec, places, value, axis.option) for value in axis.values)
    features = features_of(make_task(spec))
    for offered in specs:
        check_senses(policy, spec, offered, features, features_of(make_task(offered)))
    trained = _value(spec, places)
    if axis.part == "observation" and axis.name == "range":
        trained = _checked_sight(axis, spec, trained)
    return AxisSpecs(trained, specs)


def _checked_sight(axis: Axis, spec: TaskSpec, trained: float | None) -> float | None:
    """The range of the robots' sensors, which the range of the model limits."""
    model = spec.observation
    if not isinstance(model, LidarModel | BearingModel):
        return trained
    if max(axis.values) > model.range:
        raise SpecError(
            f"{axis.option}: got {max(axis.values):g} m, but the {model.kind} of this policy sees "
            f"{model.range:g} m. Larger values change nothing; use values up to {model.range:g}."
        )
    limits = [robot.sensor_range or model.range for robot in spec.robots]
    return min(limits[0], model.range) if len(set(limits)) == 1 else None


def parameters(spec: TaskSpec, part: Part) -> dict[str, tuple[Place, ...]]:
    """Returns the parameters of a spec that can be swept, and the places that each of them sets.

    Fields come from the models themselves. The observation range is the limit of the `state` model;
    for other models it is the range of the robots' sensors, which does not change the unit.
    """
    if part == "body":
        return _body_parameters(spec)
    model = getattr(spec, part)
    features = features_of(make_task(spec))
    found: dict[str, tuple[Place, ...]] = {}
    for path, is_whole in _fields(type(model)):
        name, place = ".".join(path), (part, *path)
        is_unit = part == "observation" and name == UNIT_FIELDS[model.kind]
        if is_unit or _is_idle(spec, model, path):
            continue
        if not (is_whole and _changes_features(spec, place, features)):
            found[name] = (place,)
    short = {name: (field,) for name, field in SHORT_NAMES.items()}
    found |= {name: found[path[0]] for name, path in short.items() if path[0] in found}
    if part == "observation":
        for name, kind in JOINT_NAMES.items():
            found[name] = tuple((part, name, each) for each in kind.model_fields)
        sensors = tuple(("team", k, "robot", "sensor_range") for k in range(len(spec.team)))
        found["range"] = found["limit"] if isinstance(model, StateModel) else sensors
    return found


def _body_parameters(spec: TaskSpec) -> dict[str, tuple[Place, ...]]:
    """The places of each limit in every role that has it, and those of a payload."""
    found: dict[str, tuple[Place, ...]] = {}
    for name in BODY_FIELDS:
        roles = [
            k
            for k, role in enumerate(spec.team)
            if name not in UNICYCLE_FIELDS or role.robot.dynamics == "unicycle"
        ]
        if roles:
            found[name] = tuple(("team", k, "robot", name) for k in roles)
    if (payload := spec.rules.payload_field) is not None:
        found |= {name: (("rules", payload, key),) for name, key in PAYLOAD_RANGES.items()}
    return found


def changed(spec: TaskSpec, places: tuple[Place, ...], value: float, source: str) -> TaskSpec:
    """Sets a value in all these places of a spec, and draws it no more.

    An absent part gets its defaults. An error names `source`.
    """
    data = spec.model_dump(mode="json")
    for *path, last in places:
        data.get("randomization", {}).pop(_range_of((*path, last)), None)
        node: Any = data
        for key in path:
            if isinstance(node, dict) and node.get(key) is None:
                node[key] = {}
            node = node[key]
        node[last] = value
    return TaskSpec.parse(data, source)


def _range_of(place: Place) -> str | int:
    """The field of `Randomization` of which a value at this place is one draw, if there is one."""
    match place:
        case ("observation", "noise", _):
            return "noise"
        case ("team" | "communication", *_):
            return place[-1]
        case ("rules", _, field):
            return f"payload_{field}"
    return ""


def _value(spec: TaskSpec, places: tuple[Place, ...]) -> float | None:
    """The number in all these places; None if there is no single one."""
    found = set()
    for place in places:
        node: Any = spec
        for key in place:
            if node is not None:
                node = node[key] if isinstance(key, int) else getattr(node, key)
        found.add(node)
    return found.pop() if len(found) == 1 else None


def _fields(model: type[Frozen]) -> Iterator[tuple[tuple[str, ...], bool]]:
    """The paths of all numbers in a model, and whether each is an integer."""
    for name, field in model.model_fields.items():
        kinds = set(classes_in(field.annotation))
        if kinds & {int, float}:
            yield (name,), float not in kinds
        for kind in kinds:
            if issubclass(kind, Frozen):
                yield from (((name, *path), is_whole) for path, is_whole in _fields(kind))


def _is_whole(part: Part, name: str) -> bool:
    """Whether the models of a part have an integer field of this name."""
    if part == "body":
        return dict(_fields(Robot)).get((name,), False)
    path = tuple(SHORT_NAMES.get(name, name).split("."))
    models = classes_in(TaskSpec.model_fields[part].annotation)
    return any(dict(_fields(model)).get(path, False) for model in models)


def _is_idle(spec: TaskSpec, model: Frozen, path: tuple[str, ...]) -> bool:
    """Whether a field has no effect in this model of a spec."""
    if isinstance(model, Broadcast):
        needed: Mapping[str, bool] = {
            "n_nearest": model.topology == "nearest",
            "message_size": model.payload == "learned",
        }
        return not needed.get(path[0], True)
    if isinstance(model, ObservationModel):
        has_headings = any(robot.dynamics == "unicycle" for robot in spec.robots)
        idle = {
            "noise": path[-1] not in model.noises,
            "drift": path[-1] != "position" and not has_headings,
            "landmarks": model.drift == Drift(),
        }
        return idle.get(path[0], False)
    return False


def _changes_features(spec: TaskSpec, place: Place, features: tuple[Feature, ...]) -> bool:
    """Whether a change of an integer by one changes the features or the actions."""
    now = _value(spec, (place,)) or 0
    for value in (now + 1, now - 1):
        try:
            other = changed(spec, (place,), value, "a probe")
            names = [feature.name for feature in features_of(make_task(other))]
        except SpecError:  # out of range: try the other one
            continue
        before = [feature.name for feature in features]
        return (names, other.action_size) != (before, spec.action_size)
    return False
