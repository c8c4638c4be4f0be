"""Frozen data that comes from outside: checked once, with one clear error, and hashed."""

import hashlib
import json
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, Self, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from swarmdata.errors import SpecError, UnknownNameError, did_you_mean
from swarmdata.runtime.documents import parse_document, read_document

LEAST_POSITIVE = 1e-12
"""Below this, products and ratios of a few quantities leave what float32 can hold."""


def _not_tiny(value: float) -> float:
    if value < LEAST_POSITIVE:
        raise ValueError(f"{value:g} is too small, expected at least {LEAST_POSITIVE:g}")
    return value


Positive = Annotated[float, Field(gt=0, le=1e12, allow_inf_nan=False), AfterValidator(_not_tiny)]
NonNegative = Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]


class Frozen(BaseModel):
    """A frozen pydantic model that refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def parse(cls, data: Any, source: str = "") -> Self:
        """Builds the model from plain data.

        Raises:
            SpecError: one message naming the path of every wrong key or value.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            where = f" in {source}" if source else ""
            raise SpecError(f"invalid {cls.__name__}{where}: {_explain_all(cls, error)}") from error

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no spaces, every default written out."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))

    def to_yaml(self) -> str:
        """The same content as readable YAML, in field order."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)

    def hash(self) -> str:
        """SHA-256 of the canonical JSON, hex; stable across processes and platforms."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()

    @classmethod
    def from_text(cls, text: str, source: str = "text") -> Self:
        """Builds the model from YAML or JSON text.

        Raises:
            SpecError: it is malformed, with the place.
        """
        return cls.parse(parse_document(text, source), source)

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """Builds the model from a `.yaml` or `.json` file.

        Raises:
            OSError: it cannot be read, is no regular file, or is too large.
            SpecError: it is malformed, with the place.
        """
        return cls.parse(read_document(Path(path)), str(path))


TaggedModel = TypeVar("TaggedModel", bound=Frozen)


def read_tagged(
    source: Mapping[str, Any] | str | Path, kinds: Mapping[str, type[TaggedModel]], what: str
) -> TaggedModel:
    """Builds the model of a union whose `kind` says which.

    Args:
        source: its fields, YAML or JSON text of them, or a file that `is_file` with such text.
        kinds: the models of the union by their `kind`.
        what: is described, for messages, such as "observation model".

    Raises:
        UnknownNameError: no such kind.
        SpecError: it cannot be read, or is not that model.
    """
    if isinstance(source, Mapping):
        return _kind_of(source, kinds, what, what).parse(dict(source), what)
    where = f"text of {what}"
    if is_file(source):
        where = str(source)
        try:
            data = read_document(Path(source))
        except OSError as error:
            raise SpecError(
                f"cannot read the {what} {where!r}: {error}. Expected a YAML or JSON file with the "
                "fields of one model."
            ) from error
    else:
        data = parse_document(str(source), where)
    return _kind_of(data, kinds, what, where).parse(data, where)


def is_file(source: str | Path) -> bool:
    """Whether this names a file of YAML or JSON, by type or by ending."""
    return isinstance(source, Path) or source.endswith((".yaml", ".yml", ".json"))


def is_inline(source: str) -> bool:
    """Whether this is YAML or JSON text rather than a name."""
    return any(mark in source for mark in ":{[\n")


def _kind_of(
    data: Any, kinds: Mapping[str, type[TaggedModel]], what: str, where: str
) -> type[TaggedModel]:
    if not isinstance(data, Mapping) or "kind" not in data:
        raise SpecError(
            f"{where}: got {SHORT_REPR.repr(data)}, expected a mapping with a key 'kind' "
            f"({', '.join(kinds)}) and the fields of that model"
        )
    if str(data["kind"]) not in kinds:
        raise UnknownNameError(what, str(data["kind"]), kinds)
    return kinds[str(data["kind"])]


MAX_LISTED_PROBLEMS = 20
"""That one message lists."""

MAX_LISTED_CHARACTERS = 2_000
"""Characters after which a message lists no further problem."""

SHORT_REPR = reprlib.Repr()
SHORT_REPR.maxstring = SHORT_REPR.maxother = SHORT_REPR.maxlong = 100


def _explain_all(model: type[BaseModel], error: ValidationError) -> str:
    every = error.errors()
    # a sequence whose only items are wrong is said to be too short, which is no news
    wrong = {problem["loc"][:k] for problem in every for k in range(len(problem["loc"]))}
    found = [each for each in every if each["type"] != "too_short" or each["loc"] not in wrong]
    listed = ""
    for n, problem in enumerate(found):
        if n == MAX_LISTED_PROBLEMS or len(listed) > MAX_LISTED_CHARACTERS:
            return f"{listed}; and {len(found) - n} more"
        listed += ("; " if listed else "") + _explain(model, problem)
    return listed


def _explain(model: type[BaseModel], problem: Any) -> str:
    path = ".".join(_key(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, problem["loc"][:-1])
        hint = did_you_mean(str(problem["loc"][-1]), known)
        return f"{path}: unknown key.{hint} Known: {', '.join(known)}"
    if problem["type"] == "union_tag_invalid":
        told, tags = problem["ctx"]["discriminator"].strip("'"), problem["ctx"]["expected_tags"]
        known = [tag.strip("'") for tag in tags.split(", ")]
        tag = str(problem["ctx"]["tag"])
        hint = did_you_mean(tag, known)
        return f"{path}.{told}: unknown {SHORT_REPR.repr(tag)}.{hint} Known: {', '.join(known)}"
    is_shown = path and problem["type"] not in ("missing", "value_error")
    got = f" (got {SHORT_REPR.repr(problem['input'])})" if is_shown else ""
    return f"{path or model.__name__}: {problem['msg'].removeprefix('Value error, ')}{got}"


def _key(part: Any) -> str:
    """A key or index as a part of a path; strange ones are quoted and shortened."""
    text = str(part)
    is_plain = text.isascii() and text.isprintable() and 0 < len(text) <= 100
    return text if is_plain else SHORT_REPR.repr(text)


def _known_keys(model: type[BaseModel], loc: tuple[Any, ...]) -> list[str]:
    """Fields of the nested model at `loc`; tuple positions do not descend, tags choose."""
    options = [model]
    for part in loc:
        fields = [option.model_fields[part] for option in options if part in option.model_fields]
        if fields:
            options = list(_nested_models(fields[0].annotation)) or options
        else:
            options = [option for option in options if part in _tags(option)] or options
    return list(options[0].model_fields)


def _tags(model: type[BaseModel]) -> set[Any]:
    """Values of the model's literal fields, one of which tells it from others of its union."""
    return {field.default for field in model.model_fields.values()}


def _nested_models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _nested_models(inner)


class Dumps(Protocol):
    """What can be written as plain data: every `Frozen`, and the protocols that they keep."""

    def model_dump(self, *, mode: Literal["json"]) -> dict[str, Any]:
        """The fields as plain data."""
        ...


def differences(one: Dumps, other: Dumps) -> Iterator[tuple[str, Any, Any]]:
    """Yields (path, value in one, value in the other) of every field in which two models differ."""
    return _differences("", one.model_dump(mode="json"), other.model_dump(mode="json"))


def _differences(path: str, one: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted(one.keys() | other.keys()):
            yield from _differences(f"{path}.{key}" if path else key, one.get(key), other.get(key))
    elif isinstance(one, Sequence) and not isinstance(one, str) and _same_size(one, other):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(f"{path}[{index}]", *pair)
    elif one != other:
        yield path, one, other


def _same_size(one: Sequence[Any], other: Any) -> bool:
    return isinstance(other, Sequence) and len(one) == len(other)
