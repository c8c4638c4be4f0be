"""Typed overrides of algorithm configs, as given on a command line: `--set key=value`."""

import dataclasses
import math
import types
from collections.abc import Mapping
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from swarmdata.errors import SpecError, UnknownNameError

C = TypeVar("C")

_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def override(config: C, changes: Mapping[str, str]) -> C:
    """Returns a copy of a config dataclass with some fields replaced by parsed text.

    A field may be a bool, int, float, str, Literal, `tuple[X, ...]` (values separated by commas)
    or one of these or None (`none`).

    Args:
        config: a frozen dataclass.
        changes: field name to text.

    Raises:
        UnknownNameError: there is no such field; the nearest name is suggested.
        SpecError: the text is not a value of the field's type.
    """
    hints = get_type_hints(type(config))
    names = [field.name for field in dataclasses.fields(config)]  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for name, text in changes.items():
        if name not in names:
            raise UnknownNameError("setting", name, names)
        try:
            values[name] = _parse(hints[name], text.strip())
        except ValueError as error:
            raise SpecError(
                f"setting {name!r} of {type(config).__qualname__} got {text!r}, "
                f"expected {_describe(hints[name])}"
            ) from error
    return dataclasses.replace(config, **values)  # type: ignore[type-var]


def _parse(kind: Any, text: str) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _parse_union(arguments, text)
    if origin is Literal:
        return _choose(arguments, text)
    if origin is tuple:
        return tuple(_parse(arguments[0], part.strip()) for part in text.split(",") if part.strip())
    if kind is bool:
        return _WORDS[_choose(tuple(_WORDS), text.lower())]
    if kind is float:
        return _finite(float(text))
    if kind in (int, str):
        return kind(text)
    raise TypeError(f"config fields of type {kind} cannot be set from text")


def _parse_union(arguments: tuple[Any, ...], text: str) -> Any:
    if types.NoneType in arguments and text.lower() == "none":
        return None
    (kind,) = (argument for argument in arguments if argument is not types.NoneType)
    return _parse(kind, text)


def _choose(options: tuple[Any, ...], text: str) -> Any:
    if text not in options:
        raise ValueError(text)
    return text


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(value)
    return value


def _describe(kind: Any) -> str:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join("none" if a is types.NoneType else _describe(a) for a in arguments)
    if origin is Literal:
        return f"one of {', '.join(map(repr, arguments))}"
    if origin is tuple:
        return f"values separated by commas, each {_describe(arguments[0])}"
    words = {bool: "true or false", int: "a whole number", float: "a finite number", str: "text"}
    return words.get(kind, str(kind))
