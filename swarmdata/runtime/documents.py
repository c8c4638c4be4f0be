"""YAML and JSON from outside, read with bounds and one kind of error, which names the place.

A document has the kinds of JSON and no others: mappings, sequences, text, finite numbers,
booleans and null. YAML's dates are text; its tags for other types, and its merge keys, are refused.
Reading takes time and memory linear in the size, which is bounded, as are depth and number of
values, those that aliases repeat included.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import yaml

from swarmdata.errors import SpecError
from swarmdata.runtime.regular_files import read_regular

MAX_YAML_BYTES = 1 << 18
"""Of a text in YAML: reading them takes some seconds."""

MAX_JSON_BYTES = 1 << 24
"""Of a text in JSON, bytes: a recipe that lists a million episodes has half of it."""

MAX_DEPTH = 32
"""Of mappings and sequences inside each other."""

MAX_VALUES = 20_000
"""In a text in YAML, keys and the values that aliases repeat included."""

MAX_CONTAINERS = 400_000
"""Mappings and sequences in a text in JSON."""

MAX_INTEGER = (1 << 64) - 1
"""Largest absolute value of a whole number: seeds take 64 bits."""

MAX_DIGITS = 64
"""Characters of a number."""

JSON_SUFFIX = ".json"


def read_document(path: Path) -> Any:
    """Returns what a `.json` file, or else a YAML file, holds.

    Raises:
        OSError: the file cannot be read, is no regular file, or is too large.
        SpecError: it is not a document, with the place.
    """
    is_json = path.suffix == JSON_SUFFIX
    content = read_regular(path, MAX_JSON_BYTES if is_json else MAX_YAML_BYTES)
    return parse_json(content, str(path)) if is_json else parse_yaml(content, str(path))


def parse_document(text: str | bytes, source: str) -> Any:
    """Returns what text in YAML, or in JSON as this library writes it, holds.

    Raises:
        SpecError: it is not a document, with the place.
    """
    start = text[:64].lstrip()
    if start[:2] in ('{"', b'{"'):  # YAML may begin so as well, and takes its time
        try:
            return parse_json(text, source)
        except _MalformedError:
            pass
    return parse_yaml(text, source)


class _MalformedError(SpecError):
    """The text is not JSON at all."""


def parse_json(text: str | bytes, source: str) -> Any:
    """Returns what text in JSON holds.

    Raises:
        SpecError: it is not JSON, with the place, or exceeds a bound.
    """
    _check_size(text, MAX_JSON_BYTES, source)
    decoded = _decoded(text, source)
    if decoded.count("[") + decoded.count("{") > MAX_CONTAINERS:
        raise SpecError(
            f"{source} has more than {MAX_CONTAINERS} lists and mappings, the most allowed."
        )
    try:
        data = json.loads(decoded, **_HOOKS)
    except json.JSONDecodeError as error:
        raise _MalformedError(
            f"{source} is not JSON: line {error.lineno}, column {error.colno}: {error.msg}"
        ) from error
    except RecursionError as error:
        raise SpecError(f"{source} is nested too deeply for JSON.") from error
    except ValueError as error:
        at = decoded.find(error.text) if isinstance(error, _NumberError) else None
        where = "" if at is None else _line_and_column(decoded, at)
        raise SpecError(f"{source} is not JSON: {where}{error}") from error
    if decoded.count("[") + decoded.count("{") > MAX_DEPTH:
        _check_depth(data, source)
    if r"\u" in decoded:
        _check_surrogates(data, source)
    return data


def parse_yaml(text: str | bytes, source: str) -> Any:
    """Returns what text in YAML holds.

    Raises:
        SpecError: it is not YAML, with the place, or exceeds a bound.
    """
    _check_size(text, MAX_YAML_BYTES, source)
    decoded, loader = _decoded(text, source), None
    try:
        loader = _BoundedLoader(decoded)
        node = loader.get_single_node()
        return None if node is None else _value(node, (), count(1))
    except yaml.MarkedYAMLError as error:
        place = _place(error.problem_mark or error.context_mark)
        problem = ", ".join(filter(None, (error.context, error.problem)))
        raise SpecError(f"{source} is neither YAML nor JSON: {place}{problem}") from error
    except yaml.reader.ReaderError as error:
        raise SpecError(
            f"{source} is neither YAML nor JSON: {_line_and_column(decoded, error.position)}the "
            f"character {decoded[error.position]!a}, which YAML does not allow"
        ) from error
    finally:
        if loader is not None:
            loader.dispose()


def _check_size(text: str | bytes, most: int, source: str) -> None:
    if len(text) > most:
        raise SpecError(f"{source} has {len(text)} characters, expected at most {most}.")


def _decoded(text: str | bytes, source: str) -> str:
    try:
        decoded = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        decoded.encode("utf-8")
    except UnicodeError as error:
        raise SpecError(f"{source} is not UTF-8: {error}") from error
    return decoded


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        twice = next(key for key, n in Counter(key for key, _ in pairs).items() if n > 1)
        raise ValueError(f"key {twice!r:.100} is given twice")
    return result


class _NumberError(ValueError):
    """A number that no spec needs."""

    def __init__(self, problem: str, text: str) -> None:
        super().__init__(problem)
        self.text = text


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _NumberError(f"{text:.100} is not a finite number", text)
    return value


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        problem = f"a number of {len(text)} characters, expected at most {MAX_DIGITS}"
        raise _NumberError(problem, text)
    return int(text)


_HOOKS: Any = {
    "object_pairs_hook": _unique_keys,
    "parse_constant": _finite,
    "parse_float": _finite,
    "parse_int": _whole,
}


_CONTAINERS = frozenset({dict, list})


def _check_depth(data: Any, source: str) -> None:
    level = [data]
    for _ in range(MAX_DEPTH):
        inside = (each.values() if isinstance(each, dict) else each for each in level)
        # of the lists of a result, nearly all are of numbers only: no step in Python for each
        deeper = (values for values in inside if not _CONTAINERS.isdisjoint(map(type, values)))
        level = [each for values in deeper for each in values if type(each) in _CONTAINERS]
        if not level:
            return
    raise SpecError(f"{source} is nested deeper than {MAX_DEPTH}, the most allowed.")


def _check_surrogates(data: Any, source: str) -> None:
    try:
        json.dumps(data, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise SpecError(f"{source} has half a character (a lone surrogate): {error}") from error


class _BoundedLoader(yaml.SafeLoader):
    """Composes the nodes of a document of bounded size and depth; it constructs no objects."""

    _depth = _n_values = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        is_inner = isinstance(event, yaml.CollectionStartEvent)
        self._n_values += 1
        if self._n_values > MAX_VALUES:
            raise _error(_TOO_MANY, event.start_mark)
        if is_inner and self._depth == MAX_DEPTH:
            raise _error(_TOO_DEEP, event.start_mark)
        self._depth += is_inner
        node = super().compose_node(parent, index)
        self._depth -= is_inner
        return node


_TOO_MANY = f"there are more than {MAX_VALUES} values, the most allowed"
_TOO_DEEP = f"values are nested deeper than {MAX_DEPTH}, the most allowed"


def _without_dates() -> dict[str, list[tuple[str, Any]]]:
    """Which plain scalars are no text, by their first character."""
    left_out = {"tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:merge", "tag:yaml.org,2002:value"}
    return {
        first: [pair for pair in pairs if pair[0] not in left_out]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


_BoundedLoader.yaml_implicit_resolvers = _without_dates()
# YAML 1.1 reads 5e-05, which JSON writes, as text
_BoundedLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)

_KINDS = {"int": "whole number", "float": "finite number", "bool": "boolean", "null": "null"}

_SCALARS = yaml.constructor.SafeConstructor()


def _value(node: yaml.Node, path: tuple[str, ...], number: "count[int]") -> Any:
    """What a node stands for, once for each alias of it."""
    if next(number) > MAX_VALUES:
        raise _error(_TOO_MANY, node.start_mark)
    if len(path) == MAX_DEPTH and isinstance(node, yaml.CollectionNode):
        raise _error(_TOO_DEEP, node.start_mark)
    kind = node.tag.removeprefix("tag:yaml.org,2002:")
    if isinstance(node, yaml.SequenceNode) and kind == "seq":
        return [_value(each, (*path, str(k)), number) for k, each in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode) and kind == "map":
        return dict(_entries(node, path, number))
    if isinstance(node, yaml.ScalarNode) and kind in ("str", "null", "bool", "int", "float"):
        return _scalar(node, kind, path)
    raise _error(
        f"a value tagged {node.tag!r:.100}, expected a mapping, a list, text, a number, a boolean "
        "or null",
        node.start_mark,
        path,
    )


def _entries(
    node: yaml.MappingNode, path: tuple[str, ...], number: "count[int]"
) -> Iterator[tuple[Any, Any]]:
    """Keys and values of a mapping; keys are scalars, each given once."""
    seen = set()
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            raise _error(
                "a key that is a mapping or a list, expected text", key_node.start_mark, path
            )
        if key_node.value == "<<" and key_node.style is None:
            problem = "a merge key <<, which is not supported; write the keys out"
            raise _error(problem, key_node.start_mark, path)
        key = _value(key_node, path, number)
        if key in seen:
            raise _error(f"key {key!r:.100} is given twice", key_node.start_mark, path)
        seen.add(key)
        yield key, _value(value_node, (*path, str(key)), number)


def _scalar(node: yaml.ScalarNode, kind: str, path: tuple[str, ...]) -> Any:
    text: str = node.value
    if kind == "str":
        if not text.isascii() and re.search("[\ud800-\udfff]", text):
            raise _error("half a character (a lone surrogate)", node.start_mark, path)
        return text
    if kind in ("int", "float") and len(text) > MAX_DIGITS:
        problem = f"a number of {len(text)} characters, expected at most {MAX_DIGITS}"
        raise _error(problem, node.start_mark, path)
    construct = getattr(_SCALARS, f"construct_yaml_{kind}")
    try:
        value = construct(node)
        if kind == "float":
            _finite(str(value))
    except (ValueError, KeyError, IndexError, OverflowError) as error:
        problem = f"{text!r:.100} is no {_KINDS[kind]}"
        raise _error(problem, node.start_mark, path) from error
    if kind == "int" and abs(value) > MAX_INTEGER:
        raise _error(
            f"the whole number {text:.100}, expected at most 2**64 - 1", node.start_mark, path
        )
    return value


def _error(problem: str, mark: yaml.Mark, path: tuple[str, ...] = ()) -> yaml.MarkedYAMLError:
    where = f"{'.'.join(path)}: {problem}" if path else problem
    return yaml.MarkedYAMLError(problem=f"{where:.400}", problem_mark=mark)


def _line_and_column(text: str, at: int) -> str:
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}: "


def _place(mark: yaml.Mark | None) -> str:
    return "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
