"""Settings of algorithms: overrides as given on a command line, and spaces that `tune` draws from.

Settings that belong together may be a section of a config, a dataclass of their own:
`--set section.key=value`, or a table `section:` in a YAML file. An algorithm declares its space
beside its config, as `SPACE`; all other settings keep their defaults.
"""

import dataclasses
import math
import types
from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter

from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.learn.training.setting_ranges import check_range
from swarmdata.numerics.random import derive, uniform

C = TypeVar("C")

Needs = Mapping[str, tuple[str, tuple[Any, ...]]]
"""Settings that have an effect only with some values of another: its name, and these values.

A config class declares them as `NEEDS`; those of its base classes count too.
"""


def override(config: C, changes: Mapping[str, str]) -> C:
    """Returns a copy of a config dataclass with some settings replaced by parsed text.

    A setting may be a bool, int, float, str, Literal, `tuple[X, ...]` (values separated by commas)
    or one of these or None (`none`). A field that is a dataclass itself is a section: its settings
    are called `section.name`.
    """
    types = setting_types(type(config))
    values: dict[str, Any] = {}
    for name, text in changes.items():
        if name not in types:
            raise UnknownNameError("setting", name, types)
        try:
            values[name] = _parse(types[name], text.strip())
        except ValueError as error:
            raise SpecError(
                f"setting {name!r} of {type(config).__qualname__} got {text!r}, "
                f"expected {_describe(types[name])}"
            ) from error
    return _replace(config, values)


def needs_of(kind: type) -> Needs:
    """All that a config class and its base classes declare."""
    return ChainMap(*(vars(base).get("NEEDS", {}) for base in kind.__mro__))


def unmet_needs(config: Any) -> Needs:
    """The settings that have no effect beside the others of a config, and what they need."""
    return {
        name: (other, values)
        for name, (other, values) in needs_of(type(config)).items()
        if getattr(config, other) not in values
    }


def check_effects(config: Any, changed: Iterable[str]) -> None:
    """Refuses changed settings that have no effect beside the others, as `NEEDS` tells."""
    kind, unmet = type(config), unmet_needs(config)
    for name in unmet.keys() & set(changed):
        (other, values), default = unmet[name], getattr(kind, name)
        if getattr(config, name) != default:
            raise SpecError(
                f"setting {name!r} of {kind.__qualname__} has no effect with {other} "
                f"{getattr(config, other)!r}, expected {other} {' or '.join(map(repr, values))}. "
                f"Set {other} as well, or leave {name} at its default ({default})."
            )


def setting_types(kind: type) -> dict[str, Any]:
    """Returns the type of every setting of a config class, those of sections as `section.name`."""
    hints = get_type_hints(kind)
    types: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        hint = hints[field.name]
        if dataclasses.is_dataclass(hint):
            inner = setting_types(cast("type", hint))
            types |= {f"{field.name}.{name}": each for name, each in inner.items()}
        else:
            types[field.name] = hint
    return types


def from_json(kind: type[C], values: Mapping[str, Any]) -> C:
    """Returns the config that `dataclasses.asdict` wrote as JSON; raises as `override` does."""
    return override(kind(), as_texts(values))


def as_texts(values: Mapping[str, Any]) -> dict[str, str]:
    """Returns the settings of a YAML or JSON table as `--set` takes them, with `section.name`."""
    return {name: _text(value) for name, value in _flatten(values).items()}


def _flatten(values: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{inner}": each for inner, each in _flatten(value).items()}
        else:
            flat[str(name)] = value
    return flat


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ",".join(map(_text, value))
    words = {True: "true", False: "false", None: "none"}
    if value is None or isinstance(value, bool):
        return words[value]
    is_whole = isinstance(value, float) and value.is_integer()  # such as 2e6
    return f"{value:.0f}" if is_whole else str(value)


def _replace(config: C, values: Mapping[str, Any]) -> C:
    """Returns a copy of a config with other values, those of sections under `section.name`."""
    fields: dict[str, Any] = {}
    by_section: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, dot, inner = name.partition(".")
        if dot:
            by_section.setdefault(section, {})[inner] = value
        else:
            check_range(type(config), name, value)
            fields[name] = value
    for section, inner_values in by_section.items():
        fields[section] = _replace(getattr(config, section), inner_values)
    return dataclasses.replace(config, **fields)  # type: ignore[type-var]


def _parse(kind: Any, text: str) -> Any:
    parts = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    if types.NoneType in parts and text.lower() == "none":
        return None
    is_tuple = any(get_origin(part) is tuple for part in parts)
    value = [part.strip() for part in text.split(",") if part.strip()] if is_tuple else text
    return TypeAdapter(kind, config=ConfigDict(allow_inf_nan=False)).validate_python(value)


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


DIGITS = 3
"""Significant digits of a drawn number: more would not be told apart by any training."""


@dataclass(frozen=True, slots=True)
class LogUniform:
    """Numbers whose logarithm is uniform.

    Raises:
        SchemaError: the ends are not above 0 and in order.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0 < self.low < self.high < math.inf:
            raise SchemaError(f"{self}: expected finite ends above 0, the lower one first")

    def __contains__(self, value: Any) -> bool:
        return bool(self.low <= value <= self.high)

    def at(self, share: float) -> float:
        """The number below which a share of the draws is, rounded to `DIGITS` and in the space."""
        value = self.low * (self.high / self.low) ** share
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)


@dataclass(frozen=True, slots=True)
class Choice:
    """One of some values, each as likely as the others."""

    values: tuple[Any, ...]

    def __contains__(self, value: Any) -> bool:
        return value in self.values

    def at(self, share: float) -> Any:
        """The value at a share, in [0, 1), of the list."""
        return self.values[int(share * len(self.values))]


Space = Mapping[str, LogUniform | Choice]
"""By the name of the setting."""


def space_of(kind: Any, name: str) -> Space:
    """Returns the search space of an algorithm; SchemaError if it declares none."""
    space: Space | None = getattr(kind, "SPACE", None)
    if not space:
        raise SchemaError(
            f"{name} declares no search space. Give its class an attribute SPACE: a table of "
            "settings with `swarmdata.LogUniform(low, high)` or `swarmdata.Choice((value, value))`."
        )
    return space


def drawn_settings(space: Space, seed: int) -> Iterator[dict[str, Any]]:
    """Yields random settings from a space without end; the first n are the same for every n."""
    trial = 0
    while True:
        yield {
            name: values.at(uniform(derive(seed, trial, index)).item())
            for index, (name, values) in enumerate(space.items())
        }
        trial += 1
