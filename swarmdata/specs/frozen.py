"""Frozen data that comes from outside: checked once, with one clear error, and hashed."""

import hashlib
import json
import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Protocol, Self, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from swarmdata.errors import INSTALL_HINT, SpecError, UnknownNameError, did_you_mean, listed
from swarmdata.runtime.documents import parse_document, read_document
from swarmdata.types import shortened

LEAST_POSITIVE = 1e-12  # products and ratios of a few smaller quantities leave float32


def _not_tiny(value: float) -> float:
    if value < LEAST_POSITIVE:
        raise ValueError(f"{value:g} is too small, expected at least {LEAST_POSITIVE:g}")
    return value


Positive = Annotated[float, Field(gt=0, le=1e12, allow_inf_nan=False), AfterValidator(_not_tiny)]
NonNegative = Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]


class Frozen(BaseModel):
    """A frozen pydantic model that refuses unknown keys; equal ones have one text and one hash.

    A model may get fields later: `later_fields` are left out at their defaults, so the hashes of
    older models, and the published ones, stay what they are.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    later_fields: ClassVar[tuple[str, ...]] = ()  # their names

    def __repr__(self) -> str:
        """Shows the fields; of many, the first and the last."""
        return shortened(super().__repr__())

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
            name = cls.model_config.get("title") or cls.__name__
            raise SpecError(f"invalid {name}{where}: {_explain_all(cls, error)}") from error

    @classmethod
    def defaults(cls) -> Self:
        """The model of all defaults; unlike a call of the class, this builds no validator."""
        return cls.model_construct()

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """The fields as plain data, without later ones at their defaults; options of pydantic."""
        # no serializer that pydantic calls: in a union it would take an interrupt for another kind
        content = super().model_dump(**options)
        _leave_out_later_defaults(self, content)
        return content

    def to_json(self) -> str:
        """Canonical JSON: sorted keys, no spaces, every default written out."""
        return json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))

    def to_yaml(self) -> str:
        """The same content as readable YAML, in field order."""
        import yaml  # noqa: PLC0415  (a load writes none)

        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)

    def hash(self) -> str:
        """SHA-256 of the canonical JSON, hex; stable across processes and platforms."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()

    @model_validator(mode="before")
    @classmethod
    def _no_truth_values_for_numbers(cls, data: Any) -> Any:
        """Pydantic takes True for 1."""
        for name in data.keys() & cls.model_fields.keys() if isinstance(data, dict) else ():
            values = data[name] if isinstance(data[name], list | tuple) else (data[name],)
            if any(isinstance(each, bool) for each in values):
                kinds = _kinds_in(cls.model_fields[name].annotation)
                if bool not in kinds and not kinds.isdisjoint((int, float)):
                    raise ValueError(f"{name} is {data[name]!r}, expected a number")
        return data

    @model_validator(mode="after")
    def _without_negative_zeros(self) -> Self:
        """-0.0 equals 0.0, and has another text."""
        fields = self.__dict__
        fields.update({name: _positive_zeros(value) for name, value in fields.items()})
        return self

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


def _leave_out_later_defaults(value: Any, content: Any) -> None:
    """Removes later fields at their defaults from the plain data of a value, at any depth."""
    if isinstance(value, Frozen):
        for name, field in type(value).model_fields.items():
            if name not in content:
                continue
            inner = getattr(value, name)
            if name in value.later_fields and inner == field.get_default(call_default_factory=True):
                del content[name]
            else:
                _leave_out_later_defaults(inner, content[name])
    elif isinstance(value, Mapping):
        for inner, written in zip(value.values(), content.values(), strict=True):
            _leave_out_later_defaults(inner, written)
    elif isinstance(value, tuple | list):
        for inner, written in zip(value, content, strict=True):
            _leave_out_later_defaults(inner, written)


def _kinds_in(annotation: Any) -> set[Any]:
    """The types that an annotation is made of."""
    inner = get_args(annotation)
    return set().union(*map(_kinds_in, inner)) if inner else {annotation}


def _positive_zeros(value: Any) -> Any:
    """The same value with 0.0 for each -0.0; values without any are returned as they are."""
    if isinstance(value, float):
        return value + 0.0
    if isinstance(value, tuple | list):
        return type(value)(_positive_zeros(each) for each in value)
    if isinstance(value, dict):
        return {key: _positive_zeros(each) for key, each in value.items()}
    return value


TaggedModel = TypeVar("TaggedModel", bound=Frozen)


def read_tagged(
    source: Mapping[str, Any] | str | Path, kinds: Mapping[str, type[TaggedModel]], what: str
) -> TaggedModel:
    """Builds the model of a union that the key `kind` selects, of fields, or of text or a file.

    Messages call the union `what`, such as "observation model".

    Raises:
        UnknownNameError: no such kind.
        SpecError: it cannot be read, or is not that model.
    """
    data: Any
    if isinstance(source, Mapping):
        where, data = what, dict(source)
    elif is_file(source):
        where = str(source)
        try:
            data = read_document(Path(source))
        except OSError as error:
            raise SpecError(
                f"cannot read the {what} {where!r}: {error}. Expected a YAML or JSON file with the "
                "fields of one model."
            ) from error
    else:
        where = f"text of {what}"
        data = parse_document(str(source), where)
    if not isinstance(data, Mapping) or "kind" not in data:
        raise SpecError(
            f"{where}: got {SHORT_REPR.repr(data)}, expected a mapping with a key 'kind' "
            f"({', '.join(kinds)}) and the fields of that model"
        )
    kind = str(data["kind"])
    if kind not in kinds:
        raise UnknownNameError(what, kind, kinds, INSTALL_HINT)
    return kinds[kind].parse(data, where)


def is_file(source: str | Path) -> bool:
    """Whether this names a file of YAML or JSON, by type or by ending."""
    return isinstance(source, Path) or source.endswith((".yaml", ".yml", ".json"))


def is_inline(source: str) -> bool:
    """Whether this is YAML or JSON text rather than a name."""
    return any(mark in source for mark in ":{[\n")


MAX_LISTED_PROBLEMS = 20  # in one message
MAX_LISTED_CHARACTERS = 2_000  # after which a message lists no further problem

SHORT_REPR = reprlib.Repr()
SHORT_REPR.maxstring = SHORT_REPR.maxother = SHORT_REPR.maxlong = 100


def _explain_all(model: type[BaseModel], error: ValidationError) -> str:
    every = error.errors()
    # a sequence with wrong items only is also reported as too short, which adds nothing
    wrong = {problem["loc"][:k] for problem in every for k in range(len(problem["loc"]))}
    found = [each for each in every if each["type"] != "too_short" or each["loc"] not in wrong]
    listed = ""
    for n, problem in enumerate(found):
        if n == MAX_LISTED_PROBLEMS or len(listed) > MAX_LISTED_CHARACTERS:
            return f"{listed}; and {len(found) - n} more"
        listed += ("; " if listed else "") + _explain(model, problem)
    return listed


def explain_value(error: ValidationError) -> str:
    """What is wrong with a single value, such as an option's, in our words."""
    problems = error.errors()
    got = SHORT_REPR.repr(problems[0]["input"])
    return f"got {got}, {' or '.join(map(_sentence, problems))}"


def _explain(model: type[BaseModel], problem: Any) -> str:
    path = ".".join(_key(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, problem["loc"][:-1])
        hint = did_you_mean(str(problem["loc"][-1]), known)
        return f"{path}: unknown key.{hint} Known: {listed(str(problem['loc'][-1]), known)}"
    if problem["type"] == "union_tag_invalid":
        told, tags = problem["ctx"]["discriminator"].strip("'"), problem["ctx"]["expected_tags"]
        known = [tag.strip("'") for tag in tags.split(", ")]
        tag = str(problem["ctx"]["tag"])
        hint = did_you_mean(tag, known)
        text = f"{path}.{told}: unknown {SHORT_REPR.repr(tag)}.{hint} Known: {listed(tag, known)}"
        is_users = problem["loc"][-1] in DEFINED_BY_USERS
        return f"{text}. {INSTALL_HINT}" if is_users else text
    is_shown = path and problem["type"] not in ("missing", "value_error")
    got = f" (got {SHORT_REPR.repr(problem['input'])})" if is_shown else ""
    return f"{path or model.__name__}: {_sentence(problem)}{got}"


DEFINED_BY_USERS = ("rules", "observation", "communication")
"""Keys of a spec whose kinds another package, or a newer version of this one, may define."""

_EXPECTED = {
    "missing": "it is missing",
    **dict.fromkeys(("bool_type", "bool_parsing"), "expected true or false"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "expected a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "expected a number"),
    "finite_number": "expected a finite number",
    "string_type": "expected text",
    **dict.fromkeys(("tuple_type", "list_type"), "expected a list"),
    **dict.fromkeys(
        ("dict_type", "mapping_type", "model_type", "model_attributes_type"),
        "expected a mapping of keys to values",
    ),
    "literal_error": "expected {expected}",
    "greater_than": "expected more than {gt}",
    "greater_than_equal": "expected at least {ge}",
    "less_than": "expected less than {lt}",
    "less_than_equal": "expected at most {le}",
    "too_short": "expected at least {min_length} of them, got {actual_length}",
    "too_long": "expected at most {max_length} of them, got {actual_length}",
    "string_too_short": "expected at least {min_length} characters",
    "string_too_long": "expected at most {max_length} characters",
    "string_pattern_mismatch": "expected text of the form {pattern}",
    "union_tag_not_found": "it has no key {discriminator}",
}
"""What was expected, by pydantic's type of a problem."""


def _sentence(problem: Any) -> str:
    """What is wrong, in our words; validators have theirs."""
    known = _EXPECTED.get(problem["type"])
    if known is None:
        message: str = problem["msg"]
        return message.removeprefix("Value error, ")
    context = problem.get("ctx", {})
    return known.format(**{k: f"{v:g}" if isinstance(v, float) else v for k, v in context.items()})


def _key(part: Any) -> str:
    """A key or index as a part of a path; unusual ones are quoted and shortened."""
    text = str(part)
    is_plain = text.isascii() and text.isprintable() and 0 < len(text) <= 100
    return text if is_plain else SHORT_REPR.repr(text)


def _known_keys(model: type[BaseModel], loc: tuple[Any, ...]) -> list[str]:
    """Fields of the nested model at `loc`; positions in tuples are skipped, tags select."""
    options = [model]
    for part in loc:
        fields = [option.model_fields[part] for option in options if part in option.model_fields]
        if fields:
            options = list(_nested_models(fields[0].annotation)) or options
        else:
            options = [option for option in options if part in _tags(option)] or options
    return list(options[0].model_fields)


def _tags(model: type[BaseModel]) -> set[Any]:
    """Default values of the model's fields, one of which is its tag in a union."""
    return {field.default for field in model.model_fields.values()}


def _nested_models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models that a field may hold: of its annotation, and those that derive from them."""
    for kind in classes_in(annotation):
        if issubclass(kind, BaseModel):
            yield kind
            for child in kind.__subclasses__():
                yield from _nested_models(child)


def classes_in(annotation: Any) -> Iterator[type]:
    """Yields the classes in the annotation of a field, at any depth."""
    if isinstance(annotation, type):
        yield annotation
    for inner in get_args(annotation):
        yield from classes_in(inner)


class Dumps(Protocol):
    """What can be written as plain data: every `Frozen`, and the protocols that they keep."""

    def model_dump(self, *, mode: Literal["json"]) -> dict[str, Any]: ...


class Document(Protocol):
    """Frozen data that is parsed from JSON, compared by value and hashed, as every `Frozen` is."""

    def hash(self) -> str: ...  # SHA-256 of its canonical JSON, hex
    def to_json(self) -> str: ...  # canonical JSON
    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self: ...  # not checked


def differences(one: Dumps, other: Dumps) -> Iterator[tuple[str, Any, Any]]:
    """Yields (path, value in one, value in the other) of every field in which two models differ."""
    return _differences("", one.model_dump(mode="json"), other.model_dump(mode="json"))


MOST_DIFFERENCES = 3  # that a message about another model names


def describe_differences(there: Dumps, here: Dumps) -> str:
    """Returns the first fields in which two models differ, in their order; empty if none does."""
    order = list(here.model_dump(mode="json"))
    found = sorted(
        differences(there, here), key=lambda each: order.index(re.split(r"[.\[]", each[0])[0])
    )
    shown = SHORT_REPR.repr
    named = [f"{path} is {shown(old)}, not {shown(new)}" for path, old, new in found]
    if len(named) > MOST_DIFFERENCES + 1:  # "and 1 more" would hide one that fits
        named[MOST_DIFFERENCES:] = [f"and {len(named) - MOST_DIFFERENCES} more"]
    return "; ".join(named)


def _differences(path: str, one: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted(one.keys() | other.keys()):
            yield from _differences(f"{path}.{key}" if path else key, one.get(key), other.get(key))
    elif (
        isinstance(one, Sequence)
        and not isinstance(one, str)
        and isinstance(other, Sequence)
        and len(one) == len(other)
    ):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(f"{path}[{index}]", *pair)
    elif one != other:
        yield path, one, other
