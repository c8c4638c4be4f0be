"""Short names of observation models, such as `lidar-32+noise-0.05+stack-4`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.senses import (
    AnyObservationModel,
    BearingModel,
    LidarModel,
    ObservationModel,
    OccupancyModel,
    StateModel,
)

_KINDS: dict[str, type[StateModel | LidarModel | BearingModel | OccupancyModel]] = {
    "state": StateModel,
    "lidar": LidarModel,
    "bearing": BearingModel,
    "occupancy": OccupancyModel,
}

_SIZES = {
    "state": "n_neighbors",
    "lidar": "n_rays",
    "bearing": "n_neighbors",
    "occupancy": "cells",
}
"""What a number after the kind sets."""

_RANGES = {"state": "limit", "lidar": "range", "bearing": "range"}
"""What the modifier `range` sets: how far robots see."""

_MODIFIERS: dict[str, Callable[[str, Any], dict[str, Any]]] = {
    "noise": lambda _, std: {"noise": {"position": std, "range": std, "velocity": std}},
    "dropout": lambda _, probability: {"dropout": probability},
    "delay": lambda _, steps: {"delay": steps},
    "stack": lambda _, frames: {"stack": frames},
    "range": lambda kind, metres: {_RANGES[kind]: metres},
}


def observation_model(
    source: str | Path | Mapping[str, Any] | ObservationModel,
) -> AnyObservationModel:
    """Returns the observation model that `source` names or describes.

    Args:
        source: a model; its fields; a YAML or JSON file or text of them; or a name. A name is a
            kind, with `-<size>` if you like (`lidar-32` rays, `bearing-5` or `state-5` neighbours,
            `occupancy-11` cells), and modifiers joined by `+`: `noise-0.05` (standard deviation of
            positions and ranges, m, and of velocities, m/s), `dropout-0.1`, `delay-2` (steps),
            `stack-4` (frames), `range-1.5` (m; not of `occupancy`, whose cells say it).

    Raises:
        UnknownNameError: no such kind or modifier.
        SpecError: a value out of its range, or a text or file that is no model.
    """
    if isinstance(source, StateModel | LidarModel | BearingModel | OccupancyModel):
        return source
    if isinstance(source, Mapping):
        return _from_fields(source, "")
    if isinstance(source, ObservationModel):
        raise SpecError(
            f"a {type(source).__name__} has no kind. Use one of: {', '.join(sorted(_KINDS))}"
        )
    text = str(source)
    if isinstance(source, Path) or text.endswith((".yaml", ".yml", ".json")):
        return _from_text(_read(Path(source)), text)
    if ":" in text:
        return _from_text(text, "text")
    return _from_name(text)


def _from_fields(fields: Mapping[str, Any], where: str) -> AnyObservationModel:
    kind = fields.get("kind")
    if kind is None:
        raise SpecError(
            f"an observation model{f' in {where}' if where else ''} has no kind, got the keys "
            f"{sorted(map(str, fields))}. Add one, such as kind: lidar"
        )
    return _class_of(str(kind)).parse(dict(fields), where)


def _class_of(kind: str) -> type[StateModel | LidarModel | BearingModel | OccupancyModel]:
    if kind not in _KINDS:
        raise UnknownNameError("observation model", kind, _KINDS)
    return _KINDS[kind]


def _from_text(text: str, where: str) -> AnyObservationModel:
    try:
        fields = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise SpecError(f"{where} is neither YAML nor JSON: {error}") from error
    if not isinstance(fields, dict):
        raise SpecError(
            f"{where} holds a {type(fields).__name__}, expected the fields of an observation "
            "model, such as kind: lidar"
        )
    model = type(_from_fields(fields, where))
    return model.from_text(text, where)  # which refuses a key given twice


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SpecError(
            f"cannot read an observation model from {path}: {error}. Give a YAML file or a name, "
            "such as lidar+noise-0.05"
        ) from error


def _from_name(name: str) -> AnyObservationModel:
    first, *rest = name.split("+")
    kind, has_size, size = first.partition("-")
    model = _class_of(kind)
    fields: dict[str, Any] = {"kind": kind}
    if has_size:
        fields[_SIZES[kind]] = _number(size, first, name)
    for part in rest:
        modifier, _, value = part.partition("-")
        if modifier not in _MODIFIERS:
            raise UnknownNameError("modifier of observations", modifier, _MODIFIERS)
        if modifier == "range" and kind not in _RANGES:
            raise SpecError(f"{kind} has no range in {name!r}: set cells and cell_size instead")
        added = _MODIFIERS[modifier](kind, _number(value, part, name))
        if added.keys() & fields.keys():
            raise SpecError(f"{modifier} is given twice in {name!r}. Leave one out")
        fields |= added
    return model.parse(fields, repr(name))


def _number(text: str, part: str, name: str) -> int | float:
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError as error:
        raise SpecError(
            f"{part!r} in {name!r} needs a number after the hyphen, got {text!r}, such as "
            "noise-0.05 or lidar-32"
        ) from error
