"""Frozen data that comes from outside: checked once, with one clear error, and hashed."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from swarmdata.errors import SpecError, UnknownNameError, did_you_mean

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Span = tuple[Positive, Positive]


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
            problems = "; ".join(_explain(cls, problem) for problem in error.errors())
            raise SpecError(f"invalid {cls.__name__}{where}: {problems}") from error

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
        """Builds the model from YAML or JSON text (JSON is YAML); duplicate keys are refused."""
        try:
            data = yaml.load(text, Loader=_UniqueKeyLoader)
        except yaml.YAMLError as error:
            raise SpecError(f"{source} is neither YAML nor JSON: {error}") from error
        return cls.parse(data, source)

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """Builds the model from a `.yaml` or `.json` file."""
        return cls.from_text(Path(path).read_text(encoding="utf-8"), str(path))


M = TypeVar("M", bound=Frozen)


def read_tagged(
    source: Mapping[str, Any] | str | Path, kinds: Mapping[str, type[M]], what: str
) -> M:
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
    text, where = source, f"text of {what}"
    if is_file(source):
        where = str(source)
        try:
            text = Path(source).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SpecError(
                f"cannot read the {what} {where!r}: {error}. Expected a YAML or JSON file with the "
                "fields of one model."
            ) from error
    try:
        data = yaml.safe_load(str(text))
    except yaml.YAMLError as error:
        raise SpecError(f"{where} is neither YAML nor JSON: {error}") from error
    # the model reads the text itself: it refuses a key given twice
    return _kind_of(data, kinds, what, where).from_text(str(text), where)


def is_file(source: str | Path) -> bool:
    """Whether this names a file of YAML or JSON, by type or by ending."""
    return isinstance(source, Path) or source.endswith((".yaml", ".yml", ".json"))


def is_inline(source: str) -> bool:
    """Whether this is YAML or JSON text rather than a name."""
    return any(mark in source for mark in ":{[\n")


def _kind_of(data: Any, kinds: Mapping[str, type[M]], what: str, where: str) -> type[M]:
    if not isinstance(data, Mapping) or "kind" not in data:
        raise SpecError(
            f"{where}: got {data!r}, expected a mapping with a key 'kind' ({', '.join(kinds)}) and "
            "the fields of that model"
        )
    if str(data["kind"]) not in kinds:
        raise UnknownNameError(what, str(data["kind"]), kinds)
    return kinds[str(data["kind"])]


class _UniqueKeyLoader(yaml.SafeLoader):
    """A safe YAML loader that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        twice = {key for key in keys if keys.count(key) > 1}
        if twice:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {min(twice)!r} is given twice", node.start_mark
            )
        return super().construct_mapping(node, deep)


def _explain(model: type[BaseModel], problem: Any) -> str:
    path = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, problem["loc"][:-1])
        hint = did_you_mean(str(problem["loc"][-1]), known)
        return f"{path}: unknown key.{hint} Known: {', '.join(known)}"
    if problem["type"] == "union_tag_invalid":
        told, tags = problem["ctx"]["discriminator"].strip("'"), problem["ctx"]["expected_tags"]
        known = [tag.strip("'") for tag in tags.split(", ")]
        tag = str(problem["ctx"]["tag"])
        hint = did_you_mean(tag, known)
        return f"{path}.{told}: unknown {tag!r}.{hint} Known: {', '.join(known)}"
    got = f" (got {problem['input']!r})" if problem["type"] != "missing" and path else ""
    return f"{path or model.__name__}: {problem['msg']}{got}"


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


# YAML 1.1 reads 5e-05, which JSON writes, as text
_UniqueKeyLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def differences(one: Frozen, other: Frozen) -> Iterator[tuple[str, Any, Any]]:
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
