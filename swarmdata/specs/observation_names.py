"""Short names of observation models, such as `lidar-32+noise-0.05+stack-4`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.frozen import is_file, is_inline, read_tagged
from swarmdata.specs.sensing_models import (
    AnyObservationModel,
    BearingModel,
    Drift,
    LidarModel,
    OccupancyModel,
    SensorNoise,
    StateModel,
    modified,
)

OBSERVATION_KINDS: dict[str, type[StateModel | LidarModel | BearingModel | OccupancyModel]] = {
    "state": StateModel,
    "lidar": LidarModel,
    "bearing": BearingModel,
    "occupancy": OccupancyModel,
}

_SIZES = {
    "state": "n_neighbors", "lidar": "n_rays", "bearing": "n_neighbors", "occupancy": "cells",
}  # fmt: skip
"""The field that a number after the kind sets."""

_RANGES = {"state": "limit", "lidar": "range", "bearing": "range"}
"""The field that the modifier `range` sets."""

_MODIFIERS: dict[str, Callable[[str, Any], dict[str, Any]]] = {
    "noise": lambda _, std: {"noise": dict.fromkeys(SensorNoise.model_fields, std)},
    "dropout": lambda _, probability: {"dropout": probability},
    "delay": lambda _, steps: {"delay": steps},
    "stack": lambda _, frames: {"stack": frames},
    "goal-for": lambda _, steps: {"goal_steps": steps},
    "range": lambda kind, metres: {_RANGES[kind]: metres},
    "drift": lambda _, rate: {"drift": dict.fromkeys(Drift.model_fields, rate)},
    "landmarks": lambda _, metres: {"landmarks": metres},
    "no-velocities": lambda _, __: {"velocities": False},
    "body-frame": lambda _, __: {"frame": "body"},
    "ways": lambda _, __: {"ways": True},
}

_BARE = {"no-velocities", "body-frame", "ways"}  # they have no number


def observation_model(
    source: str | Path | Mapping[str, Any] | AnyObservationModel,
    own: AnyObservationModel = StateModel.defaults(),  # noqa: B008  (frozen)
) -> AnyObservationModel:
    """Returns the observation model that `source` names or describes.

    Args:
        source: a model; its fields; a YAML or JSON file or text of them; or a name. A name is a
            kind, with `-<size>` if you like (`lidar-32` rays, `bearing-5` or `state-5` neighbours,
            `occupancy-11` cells), and modifiers joined by `+`: `noise-0.05` (standard deviation of
            positions and ranges, m, of velocities, m/s, and of directions, rad), `dropout-0.1`,
            `delay-2` (steps), `stack-4` (frames), `goal-for-10` (first steps that show the own
            goal; `goal-for-0` never does), `range-1.5` (m; not of `occupancy`, whose cells say it),
            `drift-0.02` (of the pose that odometry gives: m and rad per metre driven, rad per
            radian turned), `landmarks-0.5` (m, from which landmarks correct it), `no-velocities`
            (no features that are velocities), `body-frame` (of `state`: no own position, vectors in
            the own frame), `ways` (the way around obstacles to each place that is observed).
            Without a kind, modifiers are of the kind of `own`.

            A name modifies `own`, or the defaults of its kind if "=" stands before it. `noise`,
            `drift`, `dropout` and `delay` add to those of `own`, and another kind keeps what all
            kinds have (`ObservationModel`).
        own: model of the task, which names modify.

    Raises:
        UnknownNameError: no such kind or modifier.
        SpecError: a value out of its range, or a text or file that is no model.
    """
    if isinstance(source, StateModel | LidarModel | BearingModel | OccupancyModel):
        return source
    if isinstance(source, str) and not (is_file(source) or is_inline(source)):
        return _from_name(source, own)
    return read_tagged(source, OBSERVATION_KINDS, "observation model")


def _from_name(name: str, own: AnyObservationModel) -> AnyObservationModel:
    first, *rest = name.removeprefix("=").split("+")
    kind, has_size, size = first.partition("-")
    if _modifier(first):
        kind, has_size, rest = own.kind, "", [first, *rest]
    elif kind not in OBSERVATION_KINDS:
        raise UnknownNameError("observation model", kind, [*OBSERVATION_KINDS, *_MODIFIERS])
    fields: dict[str, Any] = {"kind": kind}
    if has_size:
        fields[_SIZES[kind]] = _number(size, first, name)
    for part in rest:
        modifier = _modifier(part)
        value = part.removeprefix(modifier)[1:]
        if not modifier:
            raise UnknownNameError("modifier of observations", part.partition("-")[0], _MODIFIERS)
        if modifier == "range" and kind not in _RANGES:
            raise SpecError(f"{kind} has no range in {name!r}: set cells and cell_size instead")
        if modifier == "body-frame" and kind != "state":
            raise SpecError(f"{kind} is in the body's frame already in {name!r}. Leave it out")
        if modifier in _BARE and part != modifier:
            raise SpecError(f"{modifier} takes no number in {name!r}, got {part!r}. Leave it out")
        number = 0 if modifier in _BARE else _number(value, part, name)
        added = _MODIFIERS[modifier](kind, number)
        if added.keys() & fields.keys():
            raise SpecError(f"{modifier} is given twice in {name!r}. Leave one out")
        fields |= added
    named = OBSERVATION_KINDS[kind].parse(fields, repr(name))
    return named if name.startswith("=") else modified(own, named, repr(name))


def _modifier(part: str) -> str:
    """The modifier that a part of a name gives; empty if it is none."""
    return next((m for m in _MODIFIERS if f"{part}-".startswith(f"{m}-")), "")


def _number(text: str, part: str, name: str) -> int | float:
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError as error:
        raise SpecError(
            f"{part!r} in {name!r} needs a number after the hyphen, got {text!r}, such as "
            "noise-0.05 or lidar-32"
        ) from error
