"""Frozen data that comes from outside: checked once, with one clear error, and hashed."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from swarmdata.errors import SpecError, did_you_mean

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
